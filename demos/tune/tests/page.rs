//! Pages of tables and verdicts.

use sinew_tune::page::{Judgement, Page, Verdict};
use sinew_tune::table::{Cell, Table};

#[test]
fn groups_have_headings_and_words_stand_below() {
    let mut table = Table::new("t", "A table", &["scene", "engine", "ms", "note"]).note("n");
    for (scene, ms) in [("a", 1.0), ("a", 2.0), ("b", 3.0)] {
        table.row(vec![scene.into(), "ours".into(), ms.into(), format!("{ms} < 9").into()]);
    }
    table.rows[2][3] = Cell::Missing;
    let mut page = Page::new("p", "p", "m");
    page.grouped(&table, Some("scene"), &["note"], |scene| format!("Scene {scene}"));
    let html = page.html();
    assert_eq!(html.matches("<h4>Scene a</h4>").count(), 1);
    assert_eq!(html.matches("<h4>").count(), 2);
    // neither the scene nor the note is a column
    assert_eq!(html.matches("<th").count() - html.matches("<thead").count(), 4);
    assert!(html.contains("<td colspan=\"2\"><div>1 &lt; 9</div>"));
    assert_eq!(html.matches("class=\"below\"").count(), 2);
}

#[test]
fn what_was_missed_comes_first() {
    let verdict = |judgement, what: String| Verdict { judgement, measured: "2 times".into(), what };
    let mut all: Vec<Verdict> =
        (0..14).map(|i| verdict(Judgement::Yes, format!("aim {i}."))).collect();
    all.push(verdict(Judgement::Open, "on a busy machine".into()));
    all.push(verdict(Judgement::No, "the last".into()));
    let mut page = Page::new("p", "p", "m");
    page.verdicts(&all);
    page.verdicts(&[]);
    let html = page.html();
    // what was not judged counts for neither side, and is grey
    assert!(html.contains("Verdicts: 14 of 15 met, 1 not judged"), "{html}");
    assert!(html.contains("<summary>2 more"), "{html}");
    assert!(html.contains("<li class=\"open\"><b>not judged</b>"), "{html}");
    let at = |words: &str| html.find(words).unwrap();
    assert!(at("the last") < at("on a busy machine") && at("on a busy machine") < at("aim 0."));
    assert_eq!(html.matches("<h2").count(), 1);
}

#[test]
fn contents_stand_above_what_they_name_and_warnings_in_one_box() {
    let mut page = Page::new("p", "p", "m");
    let warnings = ["kernels: busy", "step: busy"].map(String::from);
    page.warnings("The machine was busy", &warnings);
    page.section("a", "First & last");
    page.entry("t", "A table");
    let html = page.html();
    let nav = "<nav><a href=\"#a\">First &amp; last</a> <a href=\"#t\">A table</a> </nav>";
    assert!(html.find(nav).unwrap() < html.find("<h2 id=\"a\">").unwrap(), "{html}");
    assert_eq!(html.matches("<details class=\"warning\">").count(), 1);
    // a page without sections has no contents
    assert!(!Page::new("p", "p", "m").html().contains("<nav>"));
}
