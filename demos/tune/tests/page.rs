//! Pages of tables and verdicts.

use sinew_tune::page::{Page, Verdict};
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
    let verdict = |met, what: String| Verdict { met, measured: "2 times".into(), what };
    let mut all: Vec<Verdict> = (0..14).map(|i| verdict(true, format!("aim {i}."))).collect();
    all.push(verdict(false, "the last".into()));
    let mut page = Page::new("p", "p", "m");
    page.verdicts(&all);
    page.verdicts(&[]);
    let html = page.html();
    assert!(html.contains("Verdicts: 14 of 15 met") && html.contains("<summary>1 more"));
    assert!(html.find("the last").unwrap() < html.find("aim 0.").unwrap());
    assert_eq!(html.matches("<h2>").count(), 1);
}
