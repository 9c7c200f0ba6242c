//! Virtual lights: light tracing from a scene's lights
