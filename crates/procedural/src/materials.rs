//! The materials of the built-in scenes and their MTL file.

use std::fmt::Write as _;

/// What a surface is made of; the order is the order of the OBJ file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) enum Material {
    /// Coursed wall stone.
    Ashlar,
    /// Dressed stone of shafts, mouldings and tracery.
    Limestone,
    /// Drums of the piers.
    Drum,
    /// Vault webs in thin courses.
    Web,
    /// Plaster of the dome.
    Stucco,
    /// Flagged floor of aisles and transepts.
    Flags,
    /// Lozenge pavement of the nave's middle.
    Lozenges,
    /// White marble.
    White,
    /// Red marble.
    Red,
    /// Grey-green marble.
    Green,
    /// Leaded coloured glass, seen from a dark outside.
    Glass,
    /// Benches and doors.
    Oak,
    /// Candlesticks and lamp chains.
    Brass,
    /// Candles and altar linen.
    Linen,
    /// Carpet on the choir steps.
    Carpet,
    /// Iron.
    Iron,
}

/// The MTL fields of one material; `texture` multiplies `kd`.
pub(crate) struct Look {
    pub(crate) material: Material,
    pub(crate) name: &'static str,
    pub(crate) kd: [f64; 3],
    pub(crate) ks: f64,
    pub(crate) ns: f64,
    pub(crate) texture: Option<Texture>,
}

/// A texture file and the metres one copy of it covers.
#[derive(Clone, Copy)]
pub(crate) struct Texture {
    pub(crate) file: &'static str,
    pub(crate) metres: f64,
}

const fn matt(material: Material, name: &'static str, kd: [f64; 3]) -> Look {
    Look {
        material,
        name,
        kd,
        ks: 0.0,
        ns: 1.0,
        texture: None,
    }
}

const fn glossy(mut look: Look, ks: f64, ns: f64) -> Look {
    look.ks = ks;
    look.ns = ns;
    look
}

const fn mapped(mut look: Look, file: &'static str, metres: f64) -> Look {
    look.texture = Some(Texture { file, metres });
    look
}

/// Every material, in the order of [`Material`].
pub(crate) const LOOKS: &[Look] = &[
    mapped(
        matt(Material::Ashlar, "ashlar", [0.96; 3]),
        "textures/ashlar.png",
        2.4,
    ),
    matt(Material::Limestone, "limestone", [0.74, 0.70, 0.63]),
    mapped(
        matt(Material::Drum, "drum", [0.96; 3]),
        "textures/drum.png",
        2.4,
    ),
    mapped(
        matt(Material::Web, "web", [0.96; 3]),
        "textures/web.png",
        1.6,
    ),
    matt(Material::Stucco, "stucco", [0.78, 0.75, 0.69]),
    glossy(
        mapped(
            matt(Material::Flags, "flags", [0.94; 3]),
            "textures/flags.png",
            2.5,
        ),
        0.04,
        60.0,
    ),
    glossy(
        mapped(
            matt(Material::Lozenges, "lozenges", [0.94; 3]),
            "textures/lozenges.png",
            2.0,
        ),
        0.04,
        60.0,
    ),
    glossy(
        matt(Material::White, "white_marble", [0.74, 0.72, 0.68]),
        0.04,
        60.0,
    ),
    glossy(
        matt(Material::Red, "red_marble", [0.36, 0.13, 0.10]),
        0.04,
        60.0,
    ),
    glossy(
        matt(Material::Green, "green_marble", [0.12, 0.19, 0.16]),
        0.04,
        60.0,
    ),
    glossy(
        mapped(
            matt(Material::Glass, "glass", [0.92; 3]),
            "textures/glass.png",
            1.5,
        ),
        0.05,
        80.0,
    ),
    mapped(
        matt(Material::Oak, "oak", [0.95; 3]),
        "textures/oak.png",
        1.0,
    ),
    glossy(
        matt(Material::Brass, "brass", [0.42, 0.31, 0.12]),
        0.3,
        40.0,
    ),
    matt(Material::Linen, "linen", [0.80, 0.79, 0.75]),
    matt(Material::Carpet, "carpet", [0.42, 0.07, 0.06]),
    glossy(matt(Material::Iron, "iron", [0.08, 0.08, 0.08]), 0.08, 30.0),
];

/// The row of [`LOOKS`] that describes `material`.
pub(crate) fn look(material: Material) -> &'static Look {
    &LOOKS[material as usize]
}

/// The MTL file.
pub(crate) fn mtl() -> Vec<u8> {
    let mut text = String::new();
    for look in LOOKS {
        let [r, g, b] = look.kd;
        let illum = if look.ks > 0.0 { 2 } else { 1 };
        writeln!(text, "newmtl {}\nKd {r} {g} {b}", look.name).expect("a string takes any text");
        writeln!(
            text,
            "Ks {0} {0} {0}\nNs {1}\nillum {illum}",
            look.ks, look.ns
        )
        .expect("a string takes any text");
        if let Some(texture) = look.texture {
            writeln!(text, "map_Kd {}", texture.file).expect("a string takes any text");
        }
        text.push('\n');
    }
    text.into_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_follows_the_enum_and_reflects_no_more_than_it_receives() {
        for (index, look) in LOOKS.iter().enumerate() {
            assert_eq!(look.material as usize, index, "{}", look.name);
            for kd in look.kd {
                assert!(
                    kd + look.ks <= 1.0,
                    "{}: Kd + Ks is {}",
                    look.name,
                    kd + look.ks
                );
            }
        }
    }
}
