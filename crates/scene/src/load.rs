//! Reading `scene.ron`, OBJ, MTL and textures.
