//! Records the commit that the binary is built from, for reports.

use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=../../.git/HEAD");
    println!("cargo::rerun-if-changed=../../.git/refs/heads");
    let commit = Command::new("git")
        .args([
            "describe",
            "--always",
            "--dirty",
            "--abbrev=12",
            "--exclude=*",
        ])
        .output()
        .ok()
        .filter(|out| out.status.success())
        .and_then(|out| String::from_utf8(out.stdout).ok())
        .unwrap_or_default();
    let commit = if commit.trim().is_empty() {
        "unknown"
    } else {
        commit.trim()
    };
    println!("cargo::rustc-env=MANYLIGHT_COMMIT={commit}");
}
