//! RON files: overrides by path, bare variants, errors that name file, line, column and field
