//! Statistical checks for tests: chi-square, z-test
