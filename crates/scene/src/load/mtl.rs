//! MTL files: every line of interest is checked, put into the plain form that tobj reads without panicking
//! (three numbers for a colour), and read by tobj.

use std::collections::{BTreeSet, HashMap};
use std::fmt::Write;

use glam::Vec3;

use crate::brdf::LEAST_ALPHA;
use crate::load::source::{Source, join};
use crate::load::{Parts, lenient_text, lines, texture};
use crate::{Channel, Material, SceneError, alpha_of_exponent};

/// Largest Phong exponent.
const SHARPEST: f32 = 1e6;

/// The file that holds a line, and the line.
struct At<'a> {
    file: &'a str,
    line: usize,
}

impl At<'_> {
    fn error(&self, message: impl Into<String>) -> SceneError {
        SceneError::line(self.file, self.line, message)
    }
}

/// A material's texture as the file names it.
struct Map {
    line: usize,
    key: &'static str,
    /// Name in the source.
    name: String,
}

/// What the check finds beside the plain text.
#[derive(Default)]
struct Checked {
    /// Text for tobj.
    plain: String,
    /// `newmtl` lines and names.
    names: Vec<(usize, String)>,
    /// Texture lines, in order.
    maps: Vec<Map>,
    /// Keys that mean something to others.
    unused_keys: BTreeSet<String>,
}

/// Adds the materials of the file called `name` to `parts`.
///
/// Returns their names and where each is in `parts.materials`; of two with one name, the last counts.
pub(super) fn read(
    parts: &mut Parts,
    source: &Source,
    name: &str,
    bytes: &[u8],
) -> Result<HashMap<String, usize>, SceneError> {
    let shown = source.shown(name);
    let text = lenient_text(&shown, bytes, &mut parts.notes)?;
    let checked = check(&shown, &text, name, &mut parts.notes.remarks)?;
    let read = tobj::load_mtl_buf(&mut checked.plain.as_bytes());
    let (read, _) = read.map_err(|e| SceneError::file(&shown, e.to_string()))?;
    if !checked.unused_keys.is_empty() {
        let keys: Vec<&str> = checked.unused_keys.iter().map(String::as_str).collect();
        let remark = format!("{shown}: these keys have no effect: {}", keys.join(", "));
        parts.notes.remarks.push(remark);
    }

    let mut names = HashMap::new();
    for (at, (material, (line, _))) in read.into_iter().zip(&checked.names).enumerate() {
        let next = checked.names.get(at + 1).map_or(usize::MAX, |name| name.0);
        let first_map = checked.maps.partition_point(|map| map.line < *line);
        let end_map = checked.maps.partition_point(|map| map.line < next);
        // Of several, the last counts, as in tobj.
        let mut map = |key| {
            let mut maps = checked.maps[first_map..end_map].iter();
            let map = maps.rfind(|map| map.key == key)?;
            let texture = texture::Wanted {
                source: source.clone(),
                name: map.name.clone(),
                shown: source.shown(&map.name),
                named_by: format!("{shown}:{}: {}", map.line, map.key),
            };
            Some(parts.textures.id(texture))
        };
        let (diffuse_map, opacity_map) = (map("map_Kd"), map("map_d"));
        let normal_map = map("norm").or_else(|| map("map_Bump"));
        let emission_map = map("map_Ke");
        let mut number = |key| map(key).map(|texture| Channel { texture, index: 0 });
        let (roughness_map, metallic_map) = (number("map_Pr"), number("map_Pm"));
        // MTL has no default; a map alone is meant to be seen as it is.
        let missing_diffuse = Vec3::splat(if diffuse_map.is_some() { 1.0 } else { 0.0 });
        if material.diffuse.is_none() {
            let (name, kd) = (&material.name, missing_diffuse.x);
            let remark =
                format!("{shown}:{line}: material `{name}` has no Kd; it is taken as {kd}");
            parts.notes.remarks.push(remark);
        }
        let plain = Material {
            opacity: opacity(&material),
            alpha: match parameter(&material, "Pr") {
                Some(roughness) => (roughness * roughness).max(LEAST_ALPHA),
                // A map alone is the roughness itself.
                None if roughness_map.is_some() => 1.0,
                None => alpha_of_exponent(material.shininess.unwrap_or(1.0)),
            },
            metallic: parameter(&material, "Pm")
                .or(metallic_map.map(|_| 1.0))
                .or_else(|| parameter(&material, "Pr").map(|_| 0.0))
                .or(roughness_map.map(|_| 0.0)),
            roughness_map,
            metallic_map,
            normal_map,
            normal_scale: 1.0,
            diffuse: material.diffuse.map_or(missing_diffuse, Vec3::from),
            specular: material.specular.map_or(Vec3::ZERO, Vec3::from),
            emission: material.emissive.map_or(Vec3::ZERO, Vec3::from),
            emission_map,
            diffuse_map,
            opacity_map,
            name: material.name,
        };
        if names
            .insert(plain.name.clone(), parts.materials.len())
            .is_some()
        {
            let name = &plain.name;
            let remark =
                format!("{shown}:{line}: material `{name}` is defined again; this one counts");
            parts.notes.remarks.push(remark);
        }
        let conserving = conserve_energy(plain, &shown, *line, &mut parts.notes.remarks);
        parts.materials.push(conserving);
    }
    Ok(names)
}

/// `d`, else 1 − `Tr`, else 1. Files that give both disagree on what `Tr` means.
fn opacity(material: &tobj::Material) -> f32 {
    let transparency = parameter(material, "Tr");
    let opacity = material.dissolve.or(transparency.map(|t| 1.0 - t));
    opacity.unwrap_or(1.0)
}

/// A number that tobj hands through, which was checked before.
fn parameter(material: &tobj::Material, key: &str) -> Option<f32> {
    material.unknown_param.get(key)?.parse().ok()
}

/// Scales a material that would reflect more than it receives, with a remark. Where a map multiplies `Kd`
/// that is decided at each point instead: the map's darker texels leave room for `Ks`.
fn conserve_energy(
    mut material: Material,
    shown: &str,
    line: usize,
    remarks: &mut Vec<String>,
) -> Material {
    if material.metallic.is_some() {
        if material.specular != Vec3::ZERO {
            let name = &material.name;
            remarks.push(format!(
                "{shown}:{line}: material `{name}` has Pr or Pm, beside which Ks has no effect"
            ));
        }
        material.specular = Vec3::ZERO;
        return material;
    }
    if material.diffuse_map.is_some() {
        return material;
    }
    let sum = material.diffuse + material.specular;
    let most = sum.max_element();
    // 0.7 + 0.3 is a little above 1 in f32.
    if most > 1.0 + 1e-5 {
        let scale = sum.max(Vec3::ONE).recip();
        let name = &material.name;
        remarks.push(format!(
            "{shown}:{line}: material `{name}`: Kd + Ks reaches {most}; both are scaled so that it is 1"
        ));
        material.diffuse *= scale;
        material.specular *= scale;
    }
    // What rounding leaves above 1.
    material.specular = material.specular.min(Vec3::ONE - material.diffuse);
    material
}

/// Checks every line and writes what is of interest in plain form.
fn check(
    shown: &str,
    text: &str,
    name: &str,
    remarks: &mut Vec<String>,
) -> Result<Checked, SceneError> {
    let mut out = Checked::default();
    for (line, content) in lines(text) {
        let at = At { file: shown, line };
        let content = content.trim();
        let (key, rest) = content
            .split_once(|c: char| c.is_whitespace())
            .map_or((content, ""), |(key, rest)| (key, rest.trim()));
        if key.is_empty() || key.starts_with('#') {
            continue;
        }
        let key = canonical(key);
        if key != "newmtl" && out.names.is_empty() {
            return Err(at.error(format!("`{key}` comes before any `newmtl`")));
        }
        match key {
            "newmtl" if rest.is_empty() => {
                return Err(at.error("newmtl: the material has no name"));
            }
            "newmtl" => {
                // tobj splits names at nothing but line ends.
                writeln(&mut out.plain, "newmtl", rest);
                out.names.push((line, rest.to_owned()));
            }
            "Kd" | "Ks" | "Ke" => {
                let colour = colour(&at, key, rest)?;
                let most = if key == "Ke" { f32::MAX } else { 1.0 };
                if colour.min_element() < 0.0 || colour.max_element() > most {
                    let expected = match key {
                        "Ke" => "finite numbers, none negative",
                        _ => "numbers from 0 to 1",
                    };
                    let material = last_name(&out);
                    let message =
                        format!("{key}: found {rest} (material `{material}`); expected {expected}");
                    return Err(at.error(message));
                }
                let [r, g, b] = colour.to_array();
                writeln(&mut out.plain, key, &format!("{r} {g} {b}"));
            }
            "Ns" | "d" | "Tr" | "Pr" | "Pm" => {
                let rest = rest.strip_prefix("-halo").unwrap_or(rest);
                let number = one_number(&at, key, rest)?;
                let most = if key == "Ns" { SHARPEST } else { 1.0 };
                if !(0.0..=most).contains(&number) {
                    let material = last_name(&out);
                    let message = format!(
                        "{key}: found {number} (material `{material}`); expected 0 to {most}"
                    );
                    return Err(at.error(message));
                }
                writeln(&mut out.plain, key, &number.to_string());
            }
            "map_Kd" | "map_d" | "map_Ke" | "map_Pr" | "map_Pm" | "norm" | "map_Bump" | "bump" => {
                let key = match key {
                    "map_d" => "map_d",
                    "map_Kd" => "map_Kd",
                    "map_Ke" => "map_Ke",
                    "map_Pr" => "map_Pr",
                    "map_Pm" => "map_Pm",
                    "norm" => "norm",
                    _ => "map_Bump",
                };
                let (options, file) = map_options(rest);
                if file.is_empty() {
                    return Err(at.error(format!("{key}: there is no file name")));
                }
                if !options.is_empty() {
                    let options = options.join(" ");
                    remarks.push(format!(
                        "{shown}:{line}: {key}: options without effect: {options}"
                    ));
                }
                let file = join(name, file).map_err(|m| at.error(format!("{key}: {m}")))?;
                out.maps.push(Map {
                    line,
                    key,
                    name: file,
                });
            }
            // What follows is of no use to any renderer that does not do Whitted-style ray tracing.
            "illum" | "Ka" => {}
            key => {
                out.unused_keys.insert(key.chars().take(32).collect());
            }
        }
    }
    Ok(out)
}

/// The usual spelling of the keys that are read, in whatever case they come.
fn canonical(key: &str) -> &str {
    let known = [
        "newmtl", "Kd", "Ks", "Ke", "Ns", "d", "Tr", "Pr", "Pm", "map_Kd", "map_d", "map_Ke",
        "map_Pr", "map_Pm", "norm", "map_Bump", "bump", "illum", "Ka",
    ];
    let same = |known: &&&str| known.eq_ignore_ascii_case(key);
    known.iter().find(same).copied().unwrap_or(key)
}

fn last_name(checked: &Checked) -> &str {
    checked.names.last().map_or("", |(_, name)| name)
}

fn writeln(text: &mut String, key: &str, value: &str) {
    // Writing to a string cannot fail.
    let _ = writeln!(text, "{key} {value}");
}

/// One number for all channels, or three.
fn colour(at: &At<'_>, key: &str, rest: &str) -> Result<Vec3, SceneError> {
    let words: Vec<&str> = words(rest).take(4).collect();
    if let Some(&form @ ("spectral" | "xyz")) = words.first() {
        let message = format!(
            "{key}: the form `{key} {form}` is not supported; expected three numbers (RGB)"
        );
        return Err(at.error(message));
    }
    match words[..] {
        [one] => Ok(Vec3::splat(number(at, key, one)?)),
        [r, g, b] => Ok(Vec3::new(
            number(at, key, r)?,
            number(at, key, g)?,
            number(at, key, b)?,
        )),
        _ => {
            let message = format!("{key}: found `{rest}`; expected one number or three");
            Err(at.error(message))
        }
    }
}

fn one_number(at: &At<'_>, key: &str, rest: &str) -> Result<f32, SceneError> {
    let mut words = words(rest);
    match (words.next(), words.next()) {
        (Some(word), None) => number(at, key, word),
        _ => Err(at.error(format!("{key}: found `{rest}`; expected one number"))),
    }
}

fn number(at: &At<'_>, key: &str, word: &str) -> Result<f32, SceneError> {
    match word.parse::<f32>() {
        Ok(number) if number.is_finite() => Ok(number),
        Ok(_) => Err(at.error(format!("{key}: '{word}' is not a finite number"))),
        Err(_) => Err(at.error(format!("{key}: '{word}' is not a number"))),
    }
}

/// Words up to a comment.
fn words(rest: &str) -> impl Iterator<Item = &str> {
    rest.split_whitespace()
        .take_while(|word| !word.starts_with('#'))
}

/// The options before a texture's file name, and the name, which may hold spaces.
fn map_options(rest: &str) -> (Vec<&str>, &str) {
    let mut options = Vec::new();
    let mut name = rest;
    let split = |text| str::split_once(text, char::is_whitespace);
    while name.starts_with('-') {
        let Some((option, mut after)) = split(name) else {
            break;
        };
        // (values at most, whether they are numbers)
        let (values, numeric) = match option {
            "-s" | "-o" | "-t" => (3, true),
            "-mm" => (2, true),
            "-bm" | "-boost" | "-texres" => (1, true),
            "-blendu" | "-blendv" | "-cc" | "-clamp" | "-imfchan" | "-type" => (1, false),
            _ => break,
        };
        options.push(option);
        for _ in 0..values {
            let Some((value, behind)) = split(after.trim_start()) else {
                break;
            };
            if numeric && value.parse::<f32>().is_err() {
                break;
            }
            options.push(value);
            after = behind;
        }
        name = after.trim_start();
    }
    (options, name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_before_a_file_name_are_told_from_it() {
        assert_eq!(map_options("a b.png"), (vec![], "a b.png"), "none");
        let (options, name) = map_options("-s 1 1 1 -o 0.5 -bm 2 -clamp on a b.png");
        assert_eq!(name, "a b.png", "name behind options");
        assert_eq!(
            options.join(" "),
            "-s 1 1 1 -o 0.5 -bm 2 -clamp on",
            "options"
        );
        assert_eq!(
            map_options("-odd.png"),
            (vec![], "-odd.png"),
            "not an option"
        );
    }
}
