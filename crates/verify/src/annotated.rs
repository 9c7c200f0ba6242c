//! Annotated RON files, checked against the types that they describe.

/// What [`annotated`] found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Annotated {
    /// The file, and one form of it for each choice that is commented out in it: all of them are read.
    pub forms: Vec<String>,
    /// Where the file does not say what the types do; empty if it is sound.
    pub complaints: Vec<String>,
}

/// Asks the types behind `parse`, through its errors, what they hold, and whether `text` says so:
///
/// - it is read, and so is each choice that is commented out (`// kind: Vpl(clamp: None),`) in place of the field above;
/// - every field of every struct stands in it, given or commented out;
/// - every variant of every enum is named, and has its fields shown if it has any;
/// - what a number is expected to be (`1..=65536`) is in the comment beside it or above it, in the error's words.
///
/// What stands in `elsewhere`, another annotated file, need not be repeated. `parse` returns the message of the error,
/// in the words of the ron-file crate.
pub fn annotated(
    text: &str,
    elsewhere: &str,
    parse: &dyn Fn(&str) -> Result<(), String>,
) -> Annotated {
    let mut forms = vec![text.to_owned()];
    let mut from = 0;
    while let Some(form) = forms.get(from).cloned() {
        for choice in choices(&form) {
            // A choice within a choice is found after the outer one; those beside it were found before.
            if from == 0 || choice.within(&forms[0], &form) {
                forms.push(choice.taken(&form));
            }
        }
        from += 1;
    }
    let mut complaints = Vec::new();
    for form in &forms {
        if let Err(error) = parse(form) {
            complaints.push(format!("not read: {error}\n{form}"));
        }
        let all = format!("{form}\n{text}\n{elsewhere}");
        fields(form, &all, parse, &mut complaints);
        variants(form, &all, parse, &mut complaints);
        numbers(form, &all, parse, &mut complaints);
    }
    complaints.sort();
    complaints.dedup();
    Annotated { forms, complaints }
}

/// Lines that are commented out, and what they stand for.
struct Choice {
    /// Line numbers.
    lines: std::ops::Range<usize>,
    /// Lines of the field that is given instead; empty for one more entry of a list.
    instead: std::ops::Range<usize>,
}

impl Choice {
    /// Whether all of it is a comment within a comment in `whole`, whose lines are those of `form`.
    fn within(&self, whole: &str, form: &str) -> bool {
        let at = self.lines.start;
        whole.lines().nth(at) != form.lines().nth(at)
    }

    fn taken(&self, form: &str) -> String {
        let lines = form.lines().enumerate().map(|(at, line)| match at {
            _ if self.lines.contains(&at) => line.replacen("// ", "", 1),
            _ if self.instead.contains(&at) => String::new(),
            _ => line.to_owned(),
        });
        lines.collect::<Vec<_>>().join("\n")
    }
}

/// The choices that are commented out in `form`.
fn choices(form: &str) -> Vec<Choice> {
    let lines: Vec<&str> = form.lines().collect();
    let mut found = Vec::new();
    let mut at = 0;
    while at < lines.len() {
        let line = lines[at];
        let hidden = line.trim_start().strip_prefix("// ");
        let Some(hidden) = hidden.filter(|hidden| is_value(hidden)) else {
            at += 1;
            continue;
        };
        let end = block_end(&lines, at, |line| {
            line.trim_start().strip_prefix("// ").unwrap_or("")
        });
        let mut instead = 0..0;
        if let Some(key) = hidden.split_once(": ").map(|(key, _)| key) {
            let indent = &line[..line.len() - line.trim_start().len()];
            let given = format!("{indent}{key}: ");
            if let Some(start) = (0..at).rev().find(|&i| lines[i].starts_with(&given)) {
                instead = start..block_end(&lines, start, |line| line);
            }
        }
        found.push(Choice {
            lines: at..end,
            instead,
        });
        at = end;
    }
    found
}

/// Whether a comment holds `name: value` or the beginning of an enum's value, rather than prose.
fn is_value(hidden: &str) -> bool {
    let name = hidden.find(|c: char| !c.is_alphanumeric() && c != '_');
    let (name, rest) = hidden.split_at(name.unwrap_or(hidden.len()));
    let is_variant = name.starts_with(char::is_uppercase) && rest.starts_with('(');
    let is_field = name.starts_with(char::is_lowercase) && rest.starts_with(": ");
    is_variant || is_field
}

/// The line behind the value that begins in line `start`.
fn block_end(lines: &[&str], start: usize, content: impl Fn(&str) -> &str) -> usize {
    let mut depth = 0_i32;
    for (at, line) in lines.iter().enumerate().skip(start) {
        for (_, c) in code(content(line)) {
            depth += match c {
                '(' | '[' => 1,
                ')' | ']' => -1,
                _ => 0,
            };
        }
        if depth <= 0 {
            return at + 1;
        }
    }
    lines.len()
}

/// The characters of `text` outside of comments and strings.
fn code(text: &str) -> impl Iterator<Item = (usize, char)> + '_ {
    let (mut in_string, mut in_comment) = (false, false);
    text.char_indices().filter(move |&(at, c)| {
        match c {
            '\n' => in_comment = false,
            '"' if !in_comment => in_string = !in_string,
            '/' if !in_string && text[at..].starts_with("//") => in_comment = true,
            _ => {}
        }
        !in_string && !in_comment && c != '"'
    })
}

/// Words (names and numbers) outside of comments and strings, by their bytes.
fn words(text: &str) -> Vec<std::ops::Range<usize>> {
    let mut found: Vec<std::ops::Range<usize>> = Vec::new();
    for (at, c) in code(text) {
        if c.is_alphanumeric() || "_.-".contains(c) {
            match found.last_mut() {
                Some(last) if last.end == at => last.end = at + 1,
                _ => found.push(at..at + 1),
            }
        }
    }
    found
}

/// What an error expects, as a list of the names in it.
fn expected_names<'a>(error: &'a str, unknown: &str) -> Option<Vec<&'a str>> {
    let (_, expected) = error.split_once(unknown)?.1.split_once("expected ")?;
    Some(expected.split('`').skip(1).step_by(2).collect())
}

fn has_word(text: &str, word: &str) -> bool {
    let is_part = |c: char| c.is_alphanumeric() || c == '_';
    text.match_indices(word).any(|(at, _)| {
        let before = text[..at].chars().next_back();
        let after = text[at + word.len()..].chars().next();
        !before.is_some_and(is_part) && !after.is_some_and(is_part)
    })
}

type Parse<'a> = &'a dyn Fn(&str) -> Result<(), String>;

fn fields(form: &str, all: &str, parse: Parse<'_>, complaints: &mut Vec<String>) {
    let brackets: Vec<_> = code(form).filter(|(_, c)| "()".contains(*c)).collect();
    for (i, &(open, c)) in brackets.iter().enumerate() {
        if c != '(' {
            continue;
        }
        let mut depth = 0;
        let close = brackets[i..].iter().find(|(_, c)| {
            depth += if *c == '(' { 1 } else { -1 };
            depth == 0
        });
        let inside = &form[open..close.map_or(form.len(), |&(at, _)| at)];
        let probe = format!("{}zzz: 0, {}", &form[..=open], &form[open + 1..]);
        let Err(error) = parse(&probe) else { continue };
        for field in expected_names(&error, "unknown field `zzz`").unwrap_or_default() {
            let name = format!("{field}: ");
            let first = inside.split_once(": ").map_or("", |(first, _)| first);
            // A struct that only some fields are given of is shown whole somewhere else.
            let shown = inside.contains(&name)
                || (inside.lines().count() == 1 && all.contains(&name) && !first.is_empty());
            if !shown {
                let line = form[..open].lines().last().unwrap_or_default().trim();
                complaints.push(format!("field {field} is not in: {line}("));
            }
        }
    }
}

fn variants(form: &str, all: &str, parse: Parse<'_>, complaints: &mut Vec<String>) {
    for word in words(form) {
        let after = &form[word.end..];
        if !form[word.clone()].starts_with(char::is_uppercase) || after.starts_with(':') {
            continue;
        }
        let with = |value: &str, after: &str| format!("{}{value}{after}", &form[..word.start]);
        let Err(error) = parse(&with("Zzz", after)) else {
            continue;
        };
        for variant in expected_names(&error, "unknown variant `Zzz`").unwrap_or_default() {
            if !has_word(all, variant) {
                complaints.push(format!("variant {variant} is not named"));
            }
            let rest = match after.starts_with('(') {
                true => {
                    let mut depth = 0;
                    let close = code(after).find(|(_, c)| {
                        depth += i32::from(*c == '(') - i32::from(*c == ')');
                        depth == 0
                    });
                    close.map_or("", |(at, _)| &after[at + 1..])
                }
                false => after,
            };
            let has_fields = parse(&with(&format!("{variant}(zzz: 0)"), rest))
                .is_err_and(|e| e.contains("unknown field `zzz`; expected"));
            if has_fields && !all.contains(&format!("{variant}(")) {
                complaints.push(format!("the fields of {variant} are not shown"));
            }
        }
    }
}

fn numbers(form: &str, all: &str, parse: Parse<'_>, complaints: &mut Vec<String>) {
    for word in words(form) {
        let value = &form[word.clone()];
        if value != "None" && value.parse::<f64>().is_err() {
            continue;
        }
        let before = &form[..word.start];
        let key = words(before)
            .into_iter()
            .rfind(|name| before[name.end..].starts_with(':'))
            .map_or(String::new(), |name| format!("{}: ", &before[name]));
        let line = before.lines().count().saturating_sub(1);
        let mut said = beside(form, line);
        for (at, with_key) in all.lines().enumerate() {
            if with_key.contains(&key) {
                said.push_str(&beside(all, at));
            }
        }
        for probe in ["-1", "0", "2", "1e39", "18446744073709551615", "NaN"] {
            let probed = format!("{before}{probe}{}", &form[word.end..]);
            let Err(error) = parse(&probed) else { continue };
            let Some((_, expected)) = error.rsplit_once("expected ") else {
                continue;
            };
            // The type that ron reads is no range.
            let types = ["a whole number", "a number", "a name", "values in"];
            let is_type = types.iter().any(|kind| expected.starts_with(kind));
            if !is_type
                && !expected.contains('…')
                && !expected.contains('`')
                && !said.contains(expected)
            {
                complaints.push(format!("{key}{value}: {expected:?} is not said"));
            }
        }
    }
}

/// The comment in line `at`, and the lines of comment above it.
fn beside(text: &str, at: usize) -> String {
    let lines: Vec<&str> = text.lines().collect();
    let above = lines[..at].iter().rev();
    let above = above.take_while(|line| line.trim().is_empty() || line.trim().starts_with("//"));
    let mut comments: Vec<&str> = above.copied().collect();
    comments.reverse();
    comments.push(lines[at].find("//").map_or("", |start| &lines[at][start..]));
    let words = comments.iter().flat_map(|line| line.split_whitespace());
    words
        .filter(|word| *word != "//")
        .fold(String::new(), |said, word| said + word + " ")
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOUND: &str = "(
    size: 3,    // 1..=5
    kind: Flat,
    // kind: Round(
    //     radius: 1,  // 1..=5
    // ),
)";

    /// A type with two fields, one of them an enum, in the words of the ron-file crate.
    fn parse(text: &str) -> Result<(), String> {
        let code: String = code(text).map(|(_, c)| c).collect();
        let code: String = code.split_whitespace().collect();
        let numbers = code.split(|c: char| !c.is_ascii_digit() && !"-.e".contains(c));
        let bad = numbers
            .filter_map(|n| n.parse::<f64>().ok())
            .find(|n| !(1.0..=5.0).contains(n));
        match () {
            () if code.contains("Round(zzz:") => {
                Err("unknown field `zzz`; expected `radius`".into())
            }
            () if code.contains("Flat(") => Err("`Flat` takes no values in parentheses".into()),
            () if code.contains("zzz") => {
                Err("unknown field `zzz`; expected one of `size`, `kind`".into())
            }
            () if code.contains("Zzz") => {
                Err("unknown variant `Zzz`; expected one of `Flat`, `Round`".into())
            }
            () if bad.is_some() || code.contains("NaN") => {
                Err("found something; expected 1..=5".into())
            }
            () => Ok(()),
        }
    }

    #[test]
    fn a_sound_file_has_all_its_forms_and_no_complaint() {
        let found = annotated(SOUND, "", &parse);
        assert_eq!(found.complaints, Vec::<String>::new(), "sound");
        assert_eq!(found.forms.len(), 2, "{:?}", found.forms);
        assert!(
            found.forms[1].contains("\n    kind: Round(\n"),
            "the choice"
        );
        assert!(!found.forms[1].contains("Flat"), "in place of the other");
    }

    #[test]
    fn what_is_left_out_is_complained_of() {
        for (from, to, complaint) in [
            ("size: 3,    // 1..=5", "", "field size"),
            ("radius: 1,", "", "field radius"),
            ("radius: 1,  // 1..=5", "radius: 1,", "radius: 1: \"1..=5\""),
            ("// 1..=5\n    kind", "\n    kind", "size: 3: \"1..=5\""),
            ("// kind: Round(", "// Kind: Rund(", "variant Round"),
        ] {
            let text = SOUND.replace(from, to);
            let found = annotated(&text, "", &parse).complaints;
            assert!(
                found.iter().any(|found| found.contains(complaint)),
                "no {complaint} in {found:?}"
            );
        }
    }
}
