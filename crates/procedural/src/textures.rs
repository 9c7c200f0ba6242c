//! Tiling textures synthesised in code, as PNG files in sRGB.

use crate::noise::{cloud, uniform, value};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

/// sRGB colour, 0 to 255 per channel.
type Colour = [f32; 3];

/// A texture's file name and bytes.
pub(crate) struct Png {
    pub(crate) name: &'static str,
    pub(crate) bytes: Vec<u8>,
}

/// All textures, painted in parallel; each is a function of its texel alone.
pub(crate) fn all() -> Vec<Png> {
    type Painter = fn(f32, f32) -> Colour;
    let list: [(&'static str, usize, Painter); 7] = [
        ("textures/ashlar.png", 512, ashlar),
        ("textures/drum.png", 256, drum),
        ("textures/web.png", 256, web),
        ("textures/flags.png", 512, flags),
        ("textures/lozenges.png", 256, lozenges),
        ("textures/glass.png", 256, glass),
        ("textures/oak.png", 128, oak),
    ];
    std::thread::scope(|scope| {
        let workers: Vec<_> = list
            .iter()
            .map(|&(name, size, painter)| {
                scope.spawn(move || Png {
                    name,
                    bytes: paint(size, painter),
                })
            })
            .collect();
        workers
            .into_iter()
            .map(|w| w.join().expect("painting cannot fail"))
            .collect()
    })
}

/// Evaluates `painter` at texel centres, u to the right and v upwards, both in [0, 1).
fn paint(size: usize, painter: fn(f32, f32) -> Colour) -> Vec<u8> {
    let mut texels = Vec::with_capacity(size * size * 3);
    for row in (0..size).rev() {
        for column in 0..size {
            let at = |k: usize| (k as f32 + 0.5) / size as f32;
            let colour = painter(at(column), at(row));
            texels.extend(colour.map(|c| c.clamp(0.0, 255.0).round() as u8));
        }
    }
    let mut bytes = Vec::new();
    let side = u32::try_from(size).expect("textures are small");
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Up)
        .write_image(&texels, side, side, ExtendedColorType::Rgb8)
        .expect("memory takes any image");
    bytes
}

fn scale(colour: Colour, by: f32) -> Colour {
    colour.map(|c| c * by)
}

fn mix(a: Colour, b: Colour, t: f32) -> Colour {
    std::array::from_fn(|k| a[k] + (b[k] - a[k]) * t)
}

/// Where a texel lies in a wall of blocks.
struct Block {
    column: u32,
    row: u32,
    /// Distance to the nearest joint, as a fraction of the texture.
    edge: f32,
}

/// Running bond of `rows` courses with blocks of `columns` to the width, shifted per course.
fn block(u: f32, v: f32, columns: u32, rows: u32, seed: u32) -> Block {
    let y = v * rows as f32;
    let row = y as u32 % rows;
    // Half a block to and fro, give or take, so that courses do not line up.
    let shift = 0.5 * (row % 2) as f32 + 0.24 * uniform(row, 0, seed);
    let x = (u * columns as f32 + shift).rem_euclid(columns as f32);
    let column = x as u32 % columns;
    let (fx, fy) = (x.fract(), y.fract());
    let edge = (fx.min(1.0 - fx) / columns as f32).min(fy.min(1.0 - fy) / rows as f32);
    Block { column, row, edge }
}

/// Limestone of one block: its own tone, clouded, with a trace of tooling.
fn stone(u: f32, v: f32, tone: f32, warm: f32) -> Colour {
    let base = mix([222.0, 215.0, 201.0], [214.0, 199.0, 174.0], warm);
    let clouds = cloud(u, v, 10, 7) - 0.5;
    let grain = value(u, v, 170, 11) - 0.5;
    scale(base, 1.0 + 0.12 * tone + 0.10 * clouds + 0.035 * grain)
}

/// Wall blocks of 0.6 m by 0.3 m at 2.4 m to the copy.
fn ashlar(u: f32, v: f32) -> Colour {
    let block = block(u, v, 4, 8, 3);
    let tone = uniform(block.column, block.row, 21) - 0.5;
    let warm = uniform(block.column, block.row, 22);
    let face = stone(u, v, tone, 0.75 * warm * warm);
    let joint = ((block.edge - 0.0016) / 0.0022).clamp(0.0, 1.0);
    mix(
        scale([164.0, 154.0, 137.0], 0.96 + 0.08 * cloud(u, v, 20, 5)),
        face,
        joint,
    )
}

/// Pier drums: bed joints only, 0.6 m apart.
fn drum(u: f32, v: f32) -> Colour {
    let y = v * 4.0;
    let fy = y.fract();
    let tone = uniform(y as u32, 5, 31) - 0.5;
    let warm = 0.5 * uniform(y as u32, 6, 31);
    let joint = ((fy.min(1.0 - fy) / 4.0 - 0.0018) / 0.003).clamp(0.0, 1.0);
    mix([168.0, 159.0, 143.0], stone(u, v, 0.7 * tone, warm), joint)
}

/// Vault webs: thin courses along the ridge, limewashed.
fn web(u: f32, v: f32) -> Colour {
    let block = block(u, v, 3, 8, 9);
    let tone = uniform(block.column, block.row, 41) - 0.5;
    let base = scale(
        [226.0, 219.0, 205.0],
        1.0 + 0.05 * tone + 0.07 * (cloud(u, v, 6, 8) - 0.5),
    );
    let joint = ((block.edge - 0.002) / 0.004).clamp(0.0, 1.0);
    mix(scale(base, 0.9), base, joint)
}

/// Marble: clouds drawn out into veins.
fn marble(u: f32, v: f32, base: Colour, vein: Colour, seed: u32) -> Colour {
    let drift = cloud(u, v, 8, seed);
    let ridge = (value(u + 0.2 * drift, v - 0.15 * drift, 16, seed + 1) - 0.5).abs() * 2.0;
    let veins = (1.0 - 3.0 * ridge).max(0.0);
    scale(mix(base, vein, 0.5 * veins), 0.93 + 0.14 * drift)
}

/// Flagstones of 0.625 m in two greys, every other course shifted.
fn flags(u: f32, v: f32) -> Colour {
    let (x, y) = (u * 4.0, v * 4.0);
    let (i, j) = (x as u32, y as u32);
    let edge = [x, y]
        .map(|t| t.fract().min(1.0 - t.fract()))
        .into_iter()
        .fold(1.0, f32::min);
    let tone = 1.0 + 0.08 * (uniform(i, j, 51) - 0.5);
    let seed = 60 + 5 * (i + 4 * j);
    let face = if (i + j) % 2 == 0 {
        marble(u, v, [214.0, 206.0, 193.0], [176.0, 166.0, 152.0], seed)
    } else {
        marble(u, v, [180.0, 170.0, 156.0], [206.0, 196.0, 182.0], seed)
    };
    let joint = ((edge - 0.008) / 0.012).clamp(0.0, 1.0);
    mix([120.0, 112.0, 102.0], scale(face, tone), joint)
}

/// Lozenges of white and red marble in a green lattice, 1 m across.
fn lozenges(u: f32, v: f32) -> Colour {
    let (a, b) = ((u + v) * 2.0, (u - v) * 2.0);
    let (i, j) = (a.floor() as i32, b.floor() as i32);
    let inside = [a, b].map(|t| {
        let f = t.rem_euclid(1.0);
        f.min(1.0 - f)
    });
    let edge = inside[0].min(inside[1]);
    let odd = (i + j).rem_euclid(2) == 1;
    if edge < 0.055 {
        marble(u, v, [88.0, 104.0, 96.0], [140.0, 150.0, 140.0], 80)
    } else if odd {
        // A white heart in the red stone.
        if edge > 0.3 {
            marble(u, v, [224.0, 218.0, 206.0], [190.0, 180.0, 168.0], 84)
        } else {
            marble(u, v, [164.0, 92.0, 76.0], [200.0, 146.0, 128.0], 88)
        }
    } else {
        marble(u, v, [226.0, 220.0, 208.0], [186.0, 178.0, 168.0], 92)
    }
}

/// Diamond quarries of coloured glass between leads, with a band of borders.
fn glass(u: f32, v: f32) -> Colour {
    let (a, b) = (
        (u * 10.0 + v * 6.0).rem_euclid(20.0),
        (u * 10.0 - v * 6.0).rem_euclid(20.0),
    );
    let (i, j) = (a as u32, b as u32);
    let edge = [a, b]
        .map(|t| t.fract().min(1.0 - t.fract()))
        .into_iter()
        .fold(1.0, f32::min);
    if edge < 0.07 {
        return [38.0, 38.0, 42.0];
    }
    // Symmetric in u: a and b change places, up to whole turns.
    let pick = uniform(i.min(j), i.max(j), 97);
    let pane: Colour = match (pick * 10.0) as u32 {
        0..=3 => [52.0, 82.0, 158.0],
        4..=5 => [84.0, 130.0, 184.0],
        6 => [172.0, 52.0, 44.0],
        7 => [204.0, 158.0, 66.0],
        8 => [66.0, 128.0, 88.0],
        _ => [178.0, 190.0, 196.0],
    };
    scale(pane, 0.95 + 0.3 * value(u, v, 40, 98))
}

/// Oak boards along u.
fn oak(u: f32, v: f32) -> Colour {
    let board = (v * 4.0) as u32;
    let grain = value(u, v, 4, 101) * 0.6 + value(u * 0.25, v, 64, 102) * 0.4;
    let f = (v * 4.0).fract();
    let gap = if f.min(1.0 - f) < 0.03 { 0.6 } else { 1.0 };
    let tone = 0.9 + 0.2 * uniform(board, 0, 103);
    scale(
        mix([136.0, 98.0, 63.0], [168.0, 126.0, 84.0], grain),
        gap * tone,
    )
}
