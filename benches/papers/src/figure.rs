//! A figure made again, and what it says about the paper.

use serde::Serialize;
use sinew_tune::page::{Badge, Chart, Page};
use sinew_tune::table::Table;

/// What a run says of a statement of a paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The numbers agree with it.
    Agrees,
    /// It cannot be true; the proof is printed, and the numbers of the run agree with the proof.
    PaperWrong,
    /// It hangs on something that the paper does not print; the choices that meet it are told.
    NotDetermined,
    /// The numbers do not agree with it, and neither a proof nor an unprinted choice explains that.
    Differs,
    /// It hangs on times, and the machine was too busy to judge them.
    NotJudged,
}

impl Verdict {
    /// In the order of counts.
    const ALL: [Self; 5] =
        [Self::Agrees, Self::PaperWrong, Self::NotDetermined, Self::Differs, Self::NotJudged];

    /// In words.
    pub fn word(self) -> &'static str {
        match self {
            Self::Agrees => "agrees",
            Self::PaperWrong => "the paper is wrong",
            Self::NotDetermined => "not determined",
            Self::Differs => "DIFFERS",
            Self::NotJudged => "not judged",
        }
    }

    /// Style of its badge on a page.
    fn class(self) -> &'static str {
        match self {
            Self::Agrees => "met",
            Self::PaperWrong => "wrong",
            Self::NotDetermined => "choice",
            Self::Differs => "missed",
            Self::NotJudged => "open",
        }
    }

    /// How often each was given, such as `28 agree, 3 wrong in the paper, 1 differ`.
    pub fn counted(verdicts: impl Iterator<Item = Self> + Clone) -> String {
        let words = ["agree", "wrong in the paper", "not determined by it", "differ", "not judged"];
        let count = |verdict| verdicts.clone().filter(|v| *v == verdict).count();
        let counts = Self::ALL.map(count).into_iter().zip(words).filter(|(n, _)| *n > 0);
        counts.map(|(n, word)| format!("{n} {word}")).collect::<Vec<_>>().join(", ")
    }
}

/// A statement of a paper held against the numbers of this run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// How it was judged.
    pub verdict: Verdict,
    /// The statement and the numbers.
    pub text: String,
    /// The proof where the paper is wrong, the choices where it does not determine the answer.
    pub reason: String,
    /// Whether it hangs on times, which a busy machine makes longer.
    pub timed: bool,
}

impl Finding {
    fn new(verdict: Verdict, reason: String) -> Self {
        Self { verdict, text: String::new(), reason, timed: false }
    }

    /// Whether the numbers agree; [`Finding::says`] adds what they say.
    pub fn of(agrees: bool) -> Self {
        Self::new(if agrees { Verdict::Agrees } else { Verdict::Differs }, String::new())
    }

    /// One that hangs on times.
    pub fn of_times(agrees: bool) -> Self {
        Self { timed: true, ..Self::of(agrees) }
    }

    /// One that the paper cannot be right about. `shown` is whether this run's numbers are those that the proof predicts;
    /// otherwise the finding differs.
    pub fn paper_wrong(shown: bool, proof: impl Into<String>) -> Self {
        Self::new(if shown { Verdict::PaperWrong } else { Verdict::Differs }, proof.into())
    }

    /// One that hangs on what the paper does not print. `met` is whether some choice within reason meets it, and `choices`
    /// tells which of all that were tried; otherwise the finding differs.
    pub fn not_determined(met: bool, choices: impl Into<String>) -> Self {
        Self::new(if met { Verdict::NotDetermined } else { Verdict::Differs }, choices.into())
    }

    /// Whether the numbers agree with it.
    pub fn agrees(&self) -> bool {
        self.verdict == Verdict::Agrees
    }

    /// With the statement and the numbers.
    #[must_use]
    pub fn says(self, text: impl Into<String>) -> Self {
        Self { text: text.into(), ..self }
    }

    /// The statement, and what the verdict rests on.
    pub fn whole(&self) -> String {
        let text = self.text.trim_end_matches('.');
        let label = match self.verdict {
            _ if self.reason.is_empty() => return text.to_owned(),
            Verdict::PaperWrong => "Proof",
            Verdict::NotDetermined => "Hangs on",
            _ => "Looked for",
        };
        format!("{text}. {label}: {}", self.reason.trim_end_matches('.'))
    }
}

impl Figure {
    /// What was said of its statements.
    pub fn verdicts(&self) -> impl Iterator<Item = Verdict> + Clone {
        self.findings.iter().map(|f| f.verdict)
    }

    /// Its findings, for a page.
    pub fn list(&self, page: &mut Page) {
        let texts: Vec<String> = self.findings.iter().map(Finding::whole).collect();
        let badges: Vec<Badge> = self
            .findings
            .iter()
            .zip(&texts)
            .map(|(f, what)| Badge {
                class: f.verdict.class(),
                word: f.verdict.word(),
                measured: "",
                what,
            })
            .collect();
        page.badges(&badges);
    }
}

/// A figure or table of a paper, made again.
#[derive(Default)]
pub struct Figure {
    /// How it was made: sizes and settings that the paper does not print.
    pub setting: String,
    /// What agrees with the paper and what does not.
    pub findings: Vec<Finding>,
    /// What people read.
    pub tables: Vec<Table>,
    /// All numbers, for files only.
    pub numbers: Vec<Table>,
    /// Charts.
    pub charts: Vec<Chart>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verdicts_are_counted_and_give_their_reason() {
        let findings = [
            Finding::of(true).says("a"),
            Finding::paper_wrong(true, "b is not c.").says("b is c."),
            // a proof that this run does not bear out, and a choice that nobody found, excuse nothing
            Finding::paper_wrong(false, "x").says("c"),
            Finding::not_determined(false, "n of 3 to 9").says("d"),
            Finding::not_determined(true, "n, which is 5").says("e"),
        ];
        let counted = Verdict::counted(findings.iter().map(|f| f.verdict));
        assert_eq!(counted, "1 agree, 1 wrong in the paper, 1 not determined by it, 2 differ");
        let whole: Vec<String> = findings.iter().map(Finding::whole).collect();
        assert_eq!(whole[1], "b is c. Proof: b is not c");
        assert_eq!(whole[3], "d. Looked for: n of 3 to 9");
        assert_eq!(whole[4], "e. Hangs on: n, which is 5");
    }
}
