//! The verdicts of figures that take seconds, as they are written down: one that turns over is told here first, and
//! whoever changes a verdict changes this list.

use sinew_papers::figure::Verdict::{self, Agrees, PaperWrong};
use sinew_papers::{Options, PAPER_A, PAPER_C, Source};

fn verdicts(source: &'static Source, letter: char) -> Vec<(Verdict, String)> {
    let options = Options { meshes: None, quick: true };
    let paper = source.make(&[letter], &options, |_| {}).unwrap();
    let findings = paper.figures.into_iter().flat_map(|(_, _, figure)| figure.findings);
    findings.map(|f| (f.verdict, f.text)).collect()
}

#[test]
fn verdicts_are_those_written_down() {
    let written: [(&'static Source, char, &[Verdict]); 3] = [
        // figure 2, left: gives way, the term, a cubic; the flat state; smoothness
        (&PAPER_A, 'a', &[Agrees, Agrees, Agrees, PaperWrong, Agrees]),
        // the springs are the material, with fibres too, on two kinds; stiffer and softer, on two kinds; constants at 1/3 and
        // towards 1
        (&PAPER_A, 'g', &[Agrees; 9]),
        // directions between the axes
        (&PAPER_C, 'b', &[Agrees]),
    ];
    for (source, letter, expected) in written {
        let found = verdicts(source, letter);
        let own: Vec<Verdict> = found.iter().map(|f| f.0).collect();
        assert_eq!(own, expected, "{} {letter}: {found:#?}", source.name);
    }
}
