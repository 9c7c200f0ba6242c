//! Film, EXR and PNG output, and image error figures
