//! Linker arguments of the image; nothing on the host.

use std::env;
use std::path::Path;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=../memory.x");
    println!("cargo:rerun-if-changed=src/boards");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return;
    }
    let package = env::var("CARGO_MANIFEST_DIR").expect("cargo sets the package's folder");
    let package = Path::new(&package);
    // The linker takes `memory.x` from the root, and that the board's own.
    let board = if env::var_os("CARGO_FEATURE_NUCLEO_H743ZI2").is_some() {
        "src/boards/nucleo_h743zi2"
    } else {
        "src/boards/nucleo_f429zi"
    };
    for folder in [&package.join(".."), &package.join(board)] {
        println!("cargo:rustc-link-search={}", folder.display());
    }
    for argument in ["--nmagic", "-Tlink.x", "-Tdefmt.x"] {
        println!("cargo:rustc-link-arg-bins={argument}");
        println!("cargo:rustc-link-arg-examples={argument}");
    }
}
