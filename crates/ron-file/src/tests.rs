use serde::Deserialize;

use super::*;

#[derive(Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Config {
    scene: String,
    image: Image,
    #[serde(default)]
    lights: Lights,
    #[serde(default)]
    method: Option<Method>,
    #[serde(default)]
    seed: u64,
    #[serde(default)]
    list: Vec<(f32, f32)>,
}

#[derive(Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Image {
    width: Size,
    height: Size,
    #[serde(default)]
    gamma: bool,
}

#[derive(Debug, PartialEq, Deserialize)]
#[serde(try_from = "i64")]
struct Size(u32);

impl TryFrom<i64> for Size {
    type Error = String;
    fn try_from(found: i64) -> Result<Self, String> {
        match u32::try_from(found) {
            Ok(size @ 1..=16384) => Ok(Self(size)),
            _ => Err(format!("found {found}; expected 1..=16384")),
        }
    }
}

#[derive(Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
enum Lights {
    #[default]
    AsGiven,
    Virtual {
        kind: Kind,
        count: u32,
    },
}

#[derive(Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
enum Kind {
    Vpl {
        #[serde(default)]
        clamp: Option<f32>,
    },
    Vsl {
        #[serde(default)]
        radius: Option<f32>,
    },
}

#[derive(Debug, PartialEq, Deserialize)]
enum Method {
    AllLights,
    Cuts(Cuts),
}

#[derive(Debug, PartialEq, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Cuts {
    cut: u32,
    weights: Weights,
}

#[derive(Debug, PartialEq, Default, Deserialize)]
enum Weights {
    #[default]
    Yuksel2019,
    MinMax,
}

const VARIANTS: &[&str] = &["Vpl", "Vsl", "Cuts"];

const GOOD: &str = "// a run
(
    scene: \"a.ron\", /* (nested /* [ */) */
    image: (width: 960, height: 540),
    lights: Virtual(kind: Vsl, count: 1_000_000),
    method: Cuts(cut: 10, weights: MinMax),
    list: [(1, 2), (3.5, -4e-1)],
)
";

fn read_with(text: &str, sets: &[&str]) -> Result<Config, String> {
    let sets: Vec<Override> = sets
        .iter()
        .map(|set| set.parse().expect("an override"))
        .collect();
    parse("a.ron", text, &sets, VARIANTS).map_err(|error| error.to_string())
}

fn good_with(sets: &[&str]) -> Config {
    read_with(GOOD, sets).expect("a good file")
}

#[test]
fn a_good_file_reads() {
    let config = good_with(&[]);
    let kind = Kind::Vsl { radius: None };
    let count = 1_000_000;
    assert_eq!(config.lights, Lights::Virtual { kind, count }, "lights");
    let weights = Weights::MinMax;
    let method = Some(Method::Cuts(Cuts { cut: 10, weights }));
    assert_eq!(config.method, method, "method");
    assert_eq!(config.list, [(1.0, 2.0), (3.5, -0.4)], "tuples");
}

#[test]
fn line_ends_and_byte_order_marks_do_not_matter() {
    let crlf = format!("\u{FEFF}{}", GOOD.replace('\n', "\r\n"));
    assert_eq!(read_with(&crlf, &[]), Ok(good_with(&[])), "CRLF and BOM");
}

#[test]
fn every_form_of_a_variant_with_fields_reads() {
    let cuts = |text: &str| good_with(&[&format!("method={text}")]).method;
    let default = Some(Method::Cuts(Cuts::default()));
    for form in [
        "Cuts",
        "Cuts()",
        "Some(Cuts)",
        "Cuts(cut: 0)",
        "Cuts((cut: 0))",
    ] {
        assert_eq!(cuts(form), default, "{form}");
    }
    assert_eq!(cuts("AllLights"), Some(Method::AllLights), "a unit variant");
    assert_eq!(cuts("None"), None, "no variant");
}

#[test]
fn overrides_apply() {
    let config = good_with(&[
        "method.cut=1000",
        "lights.kind=Vpl(clamp: 2)",
        "lights.count=5",
    ]);
    let weights = Weights::MinMax;
    let method = Some(Method::Cuts(Cuts { cut: 1000, weights }));
    assert_eq!(config.method, method, "method.cut");
    let kind = Kind::Vpl { clamp: Some(2.0) };
    assert_eq!(config.lights, Lights::Virtual { kind, count: 5 }, "lights");
    let config = good_with(&[
        "method=Cuts",
        "method.weights=MinMax",
        "seed=7",
        "list[1]=(0, 0)",
    ]);
    let weights = Weights::MinMax;
    let method = Some(Method::Cuts(Cuts { cut: 0, weights }));
    assert_eq!(config.method, method, "a field added to a bare variant");
    assert_eq!(config.seed, 7, "a field added to the file");
    assert_eq!(config.list[1], (0.0, 0.0), "an element");
}

#[test]
fn errors_name_place_field_value_and_expectation() {
    let mut wrong = Vec::new();
    for (from, to, expected) in [
        (
            "width: 960",
            "width: 0",
            "a.ron:4:20: image.width: found 0; expected 1..=16384",
        ),
        (
            "width: 960",
            "width: -7",
            "a.ron:4:20: image.width: found -7; expected 1..=16384",
        ),
        (
            "width: 960",
            "width: 1.5",
            "a.ron:4:20: image.width: found 1.5; expected a whole number",
        ),
        (
            "width: 960",
            "width: \"x\"",
            "a.ron:4:20: image.width: found \"x\"; expected a whole number",
        ),
        (
            "width: 960",
            "width: 99999999999999999999",
            "image.width: found 99999999999999999999; expected a whole number that is in range",
        ),
        (
            "width: 960",
            "widht: 960",
            "a.ron:4:13: image: unknown field `widht` (did you mean `width`?); expected one of `width`, `height`, `gamma`",
        ),
        (
            "width: 960, ",
            "",
            "a.ron:4:12: image: field `width` is missing",
        ),
        (
            "width: 960",
            "width: 960, width: 3",
            "a.ron:4:25: image: field `width` is given twice",
        ),
        (
            "width: 960,",
            "width: 960",
            "expected a comma before height",
        ),
        (
            "width: 960",
            "width 960",
            "a.ron:4:19: image: expected `:` before 960",
        ),
        (
            "width: 960",
            "width: ",
            "image.width: found ,; expected a whole number",
        ),
        (
            "width: 960",
            "gamma: 1, width: 960",
            "a.ron:4:20: image.gamma: found 1; expected true or false",
        ),
        (
            "(width: 960, height: 540)",
            "7",
            "a.ron:4:12: image: found 7; expected values in parentheses",
        ),
        (
            "(width: 960, height: 540)",
            "Imag(width: 960, height: 540)",
            "image: found Imag(width: 960, height: 540); expected Image( … ), or just ( … )",
        ),
        (
            "Virtual(",
            "Virtaul(",
            "a.ron:5:13: lights: unknown variant `Virtaul` (did you mean `Virtual`?); expected one of `AsGiven`, `Virtual`",
        ),
        (
            "kind: Vsl",
            "kind: Vsx",
            "a.ron:5:27: lights.kind: unknown variant `Vsx` (did you mean `Vsl`?)",
        ),
        (
            "kind: Vsl",
            "kind: \"Vsl\"",
            "a.ron:5:27: lights.kind: found \"Vsl\"; expected a name",
        ),
        (
            "kind: Vsl",
            "kind: Vsl(radius: wide)",
            "a.ron:5:39: lights.kind.radius: found wide; expected a number",
        ),
        (
            "kind: Vsl",
            "kind: Vsl(raduis: 1)",
            "a.ron:5:31: lights.kind: unknown field `raduis` (did you mean `radius`?); expected `radius`",
        ),
        (
            "1_000_000",
            "-1",
            "lights.count: found -1; expected a whole number that is in range",
        ),
        (
            "cut: 10",
            "cut: ten",
            "a.ron:6:23: method.cut: found ten; expected a whole number",
        ),
        (
            "cut: 10",
            "cutt: 10",
            "a.ron:6:18: method: unknown field `cutt` (did you mean `cut`?)",
        ),
        (
            "MinMax",
            "Minmax",
            "a.ron:6:36: method.weights: unknown variant `Minmax` (did you mean `MinMax`?)",
        ),
        (
            "(3.5, -4e-1)",
            "(3.5, x)",
            "a.ron:7:26: list[1][1]: found x; expected a number",
        ),
        (
            "(3.5, -4e-1)",
            "(3.5)",
            "a.ron:7:20: list[1]: found 1 value; expected",
        ),
        (
            "(3.5, -4e-1)",
            "(3.5, 1, 2)",
            "a.ron:7:29: list[1][2]: expected `)` before 2",
        ),
        (
            "[(1, 2), (3.5, -4e-1)]",
            "(1, 2)",
            "a.ron:7:11: list: found (1, 2); expected a list [ … ]",
        ),
        ("scene: \"a.ron\"", "scene: a.ron", "scene: found a"),
        (
            "    scene",
            "    !scene",
            "a.ron:3:5: !scene: found !; expected a name",
        ),
        (
            "[(1, 2), (3.5, -4e-1)]",
            "[(1, 2), , (3, 4)]",
            "a.ron:7:20: list[1]: found ,; expected values in parentheses",
        ),
        (
            "lights: Virtual(kind: Vsl, count: 1_000_000)",
            "lights: AsGiven(1)",
            "a.ron:5:20: lights: `AsGiven` takes no values in parentheses",
        ),
        (
            "scene: \"a.ron\"",
            "scene = \"a.ron\"",
            "a.ron:3:11: expected `:` before =",
        ),
        (
            "scene: \"a.ron\"",
            "scene: \"a\\q\"",
            "a.ron:3:12: scene: unknown escape character",
        ),
        (
            ",\n)\n",
            ",\n) 5\n",
            "a.ron:8:3: found 5 behind the value; expected nothing",
        ),
        (",\n)\n", ",\n", "a.ron:2:1: this `(` is never closed"),
        (
            ",\n)\n",
            ",\n]\n",
            "a.ron:8:1: `]` cannot close the `(` of 2:1",
        ),
        (
            "*/) */",
            "*/)",
            "a.ron:3:21: this block comment is never closed",
        ),
        (
            "\"a.ron\"",
            "\"a.ron",
            "a.ron:3:12: this string is never closed",
        ),
    ] {
        assert!(GOOD.contains(from), "{from} is in the file");
        let text = GOOD.replacen(from, to, 1);
        let error = read_with(&text, &[]).expect_err(to);
        if !error.contains(expected) || !error.starts_with("a.ron:") {
            wrong.push(format!("{to}:\n got {error}\nwant {expected}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn errors_in_overrides_name_the_override() {
    for (set, expected) in [
        (
            "image.width=0",
            "--set image.width=0: found 0; expected 1..=16384",
        ),
        (
            "lights.count=abc",
            "--set lights.count=abc: found abc; expected a whole number",
        ),
        (
            "lights.kind=Vsl(radius: x)",
            "--set lights.kind=Vsl(radius: x): lights.kind.radius: found x; expected a number",
        ),
        (
            "sede=3",
            "--set sede=3: unknown field `sede` (did you mean `seed`?)",
        ),
        (
            "method.cutt=3",
            "--set method.cutt=3: method: unknown field `cutt` (did you mean `cut`?)",
        ),
        (
            "method=Cut",
            "--set method=Cut: unknown variant `Cut` (did you mean `Cuts`?)",
        ),
        ("image=()", "--set image=(): field `width` is missing"),
        ("scene=b.ron", "--set scene=b.ron: "),
    ] {
        let error = read_with(GOOD, &[set]).expect_err(set);
        assert!(error.starts_with(expected), "{set} gave {error}");
    }
}

#[test]
fn errors_behind_edits_still_point_into_the_file() {
    let text = GOOD.replace("cut: 10", "cut: ten");
    let error = read_with(&text, &["image.width=123456", "lights.kind.radius=0.25"]);
    let error = error.expect_err("a bad cut");
    assert!(error.starts_with("--set image.width"), "{error}");
    let error = read_with(
        &text,
        &["image.width=12", "lights.kind.radius=0.25", "seed=1"],
    );
    let error = error.expect_err("a bad cut");
    assert!(error.starts_with("a.ron:6:23: method.cut: "), "{error}");
}

#[test]
fn files_that_are_no_text_are_refused() {
    let dir = tempfile::tempdir().expect("a folder");
    let file = dir.path().join("a.ron");
    let error = |bytes: &[u8]| {
        std::fs::write(&file, bytes).expect("a file");
        let error = read::<Config>(&file, &[], VARIANTS).expect_err("no config");
        error.to_string()
    };
    assert!(
        error(b"").contains("a.ron:1:1: the file holds no value; expected"),
        "empty"
    );
    assert!(
        error(b"// nothing\n").contains("holds no value"),
        "only a comment"
    );
    assert!(
        error(b"(\n \xFF").contains("a.ron:2:2: byte 0xFF is not UTF-8"),
        "bytes"
    );
    assert!(
        error(b"(\n\0 \xFF").contains("a.ron:2:1: byte 0x00 is no text"),
        "zeros"
    );
    let missing = read::<Config>(&dir.path().join("b.ron"), &[], VARIANTS);
    let missing = missing.expect_err("no file").to_string();
    assert!(
        missing.contains("b.ron: cannot be read (No such file"),
        "{missing}"
    );
}

#[test]
fn a_file_without_its_parentheses_says_so() {
    let error = read_with("scene: \"a.ron\",\nseed: 1", &[]).expect_err("no parentheses");
    let expected = "a.ron:1:1: found scene: alone; expected parentheses ( … ) around all fields";
    assert_eq!(error, expected, "the first key");
}

#[test]
fn huge_and_deep_texts_are_refused_quickly() {
    let deep = "(".repeat(100_000);
    assert!(
        read_with(&deep, &[])
            .expect_err("deep")
            .contains("never closed"),
        "open"
    );
    let closed = deep.clone() + &")".repeat(100_000);
    assert!(read_with(&closed, &[]).is_err(), "deep and closed");
    let field = format!("(scene: {closed})");
    assert!(read_with(&field, &[]).is_err(), "deep in a field");
    let set = format!("seed={closed}");
    let error = read_with(GOOD, &[&set]).expect_err("deep override");
    assert!(
        error.contains("nested too deep") && error.len() < 400,
        "{error}"
    );
    let long = format!("(scene: 5, image: \"{}\")", "x".repeat(10_000_000));
    let error = read_with(&long, &[]).expect_err("long");
    assert!(error.len() < 400, "long values are not quoted whole");
    let wide = format!("({})", "Vsl,".repeat(300_000));
    assert!(read_with(&wide, &[]).is_err(), "many variants");
}

#[test]
fn places_are_found_after_reading() {
    let at = |path| place(GOOD, path).map(|p| (p.line, p.column));
    assert_eq!(at("lights.kind"), Some((5, 27)), "a field");
    assert_eq!(at("list[1]"), Some((7, 20)), "an element");
    assert_eq!(at("list[2]"), None, "no element");
}

#[test]
fn no_text_makes_it_panic() {
    let pieces = [
        "(",
        ")",
        "[",
        "]",
        "\"",
        "'",
        ",",
        ":",
        "/*",
        "*/",
        "//",
        "\n",
        "r#\"",
        "Vsl",
        "Cuts((a: 1",
        "é",
        "\u{85}",
        "1.5",
        "-",
        "#![enable(",
        "Some(",
        "\\",
        "b'",
        "\u{FEFF}",
    ];
    verify::property(1000, |u| {
        let mut text = GOOD.to_owned();
        for _ in 0..u.int_in_range(1..=4)? {
            let at = u.choose_index(text.len() + 1)?;
            let end = text.len().min(at + u.int_in_range(0..=9)?);
            let boundary = |at: usize| (0..=at).rev().find(|&b| text.is_char_boundary(b));
            let (a, b) = (boundary(at).unwrap_or(0), boundary(end).unwrap_or(0));
            let with = *u.choose(&pieces)?;
            text.replace_range(a..b, with);
        }
        let value: String = u.arbitrary()?;
        let set = Override {
            path: "lights.kind.radius".into(),
            value,
        };
        let _ = parse::<Config>("a.ron", &text, std::slice::from_ref(&set), VARIANTS);
        let _ = parse::<Config>("a.ron", &text, &[], VARIANTS);
        let _ = parse::<Config>("a.ron", GOOD, &[set], VARIANTS);
        let noise: String = u.arbitrary()?;
        let _ = parse::<Config>("a.ron", &noise, &[], VARIANTS);
        let _ = place(&text, "lights.kind");
        Ok(())
    });
}

#[test]
fn a_text_with_overrides_put_in_needs_none() {
    let text = "( // a run\n  image: (spp: 4), lights: Vsl,\n)";
    let sets = ["image.spp=9", "lights.radius=2.0", "seed=7"];
    let sets = sets.map(|set| set.parse().expect("an override"));
    let found = overridden(text, &sets, &["Vsl"]).expect("fits");
    assert_eq!(
        found,
        "(seed: 7,  // a run\n  image: (spp: 9), lights: Vsl(radius: 2.0),\n)"
    );
    let misfit = "image.spp.x=1".parse().expect("an override");
    assert!(overridden(text, &[misfit], &[]).is_err(), "no such place");
}

#[test]
fn a_field_of_the_outermost_value_is_found() {
    assert!(has_field(
        "// a scene\n(geometry: [\"a.obj\"], lights: [])",
        "geometry"
    ));
    assert!(!has_field("(scene: (geometry: []))", "geometry"), "deeper");
    assert!(
        !has_field("(scene: \"geometry: x\")", "geometry"),
        "in a text"
    );
    assert!(!has_field("", "geometry"), "empty");
    assert!(!has_field("geometry: ((((", "geometry"), "not RON");
}
