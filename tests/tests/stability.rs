//! The verdicts of the stability table do not change unseen.

use pileus_lab::experiment::{Verdict, stability};
use pileus_tests::root;
use std::collections::BTreeMap;

/// `docs/charts/stability.csv` is what `pileus chart stability` writes. Where a change moves a
/// verdict on purpose, write the table anew:
/// `cargo run --release -p pileus -- chart stability -o docs/charts`, and say in the change log
/// why.
#[test]
fn verdicts_are_those_of_the_table() {
    let text = std::fs::read_to_string(root().join("docs/charts/stability.csv")).unwrap();
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    assert!(lines.next().unwrap().starts_with("method,stress,verdict,"));
    let mut written = BTreeMap::new();
    for line in lines {
        // Names may hold commas; then they are quoted.
        let mut cells = Vec::new();
        let mut rest = line;
        for _ in 0..3 {
            let (cell, after) = match rest.strip_prefix('"') {
                Some(quoted) => {
                    let (cell, after) = quoted.split_once('"').unwrap();
                    (cell, after.trim_start_matches(','))
                }
                None => rest.split_once(',').unwrap(),
            };
            cells.push(cell.to_owned());
            rest = after;
        }
        written.insert((cells[0].clone(), cells[1].clone()), cells[2].clone());
    }
    let measured = stability().unwrap();
    assert_eq!(written.len(), measured.cells.len(), "methods or stresses came or went");
    let changed: Vec<String> = measured
        .cells
        .iter()
        .filter_map(|cell| {
            let was = &written[&(cell.method.clone(), cell.stress.clone())];
            (was != cell.verdict.name()).then(|| {
                format!(
                    "{} under {}: was {was}, is {} (z {:.2}, deviation {:.3})",
                    cell.method,
                    cell.stress,
                    cell.verdict.name(),
                    cell.z,
                    cell.relative_deviation
                )
            })
        })
        .collect();
    assert!(changed.is_empty(), "{changed:#?}");
    // What must hold whatever the table says: exact methods never fail, and no estimate of any
    // method is not a number where bounds hold.
    for cell in &measured.cells {
        let exact = cell.method.ends_with(" regular") || cell.method.ends_with(" analytic");
        assert!(
            !exact || matches!(cell.verdict, Verdict::Ok | Verdict::Refused | Verdict::Noisy),
            "{cell:?}"
        );
        assert!(cell.stress.starts_with("broken") || cell.non_finite == 0, "{cell:?}");
        assert_eq!(cell.verdict == Verdict::Ok, cell.reason.is_empty(), "{cell:?}");
    }
}
