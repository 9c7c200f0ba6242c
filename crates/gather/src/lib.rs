//! Many-light methods and the renderer that gathers light at each shading point
