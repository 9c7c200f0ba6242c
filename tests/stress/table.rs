//! The table of all findings.

use std::fmt::Write;

use crate::check::Finding;

/// One row a group of cases, in their order.
pub(crate) fn markdown(findings: &[Finding]) -> String {
    let mut text = String::from(
        "| condition | checks | passed | all lights against what is known | methods against all lights | worst z |\n\
         | --- | ---: | ---: | ---: | ---: | ---: |\n",
    );
    let mut groups: Vec<&str> = Vec::new();
    for finding in findings {
        if !groups.contains(&finding.group) {
            groups.push(finding.group);
        }
    }
    for group in groups {
        let rows: Vec<_> = findings.iter().filter(|f| f.group == group).collect();
        row(&mut text, group, &rows);
    }
    row(&mut text, "all", &findings.iter().collect::<Vec<_>>());
    text
}

fn row(text: &mut String, name: &str, findings: &[&Finding]) {
    let passed = findings.iter().filter(|f| f.problem.is_none()).count();
    let greatest = |values: &mut dyn Iterator<Item = f64>| values.map(f64::abs).fold(0.0, f64::max);
    let known = greatest(&mut findings.iter().filter_map(|f| f.off_known));
    let differences = || findings.iter().filter_map(|f| f.off_all);
    let _ = writeln!(
        text,
        "| {name} | {} | {passed} | {known:.1e} | {:.1} % | {:.1} |",
        findings.len(),
        100.0 * greatest(&mut differences().map(|d| d.relative)),
        greatest(&mut differences().filter_map(|d| d.z)),
    );
}
