//! Tables in all their forms.

use sinew_tune::table::{Cell, Table, three_digits};

fn table() -> Table {
    let mut table = Table::new("t", "A table", &["what", "ms"]).note("x < y");
    table.row(vec!["a, \"b\"".into(), 1.23456.into()]);
    table.row(vec!["long | name".into(), None::<f64>.into()]);
    table.marked = vec![1];
    table
}

#[test]
fn numbers_have_three_digits() {
    let shown = [0.0, 12345.0, 123.4, 12.34, 1.234, 0.01234, 1e-9, 2.5e7, -3.456];
    let text = ["0", "12345", "123", "12.3", "1.23", "0.0123", "1.0e-9", "2.5e7", "-3.46"];
    assert_eq!(shown.map(three_digits), text);
}

#[test]
fn every_form_holds_every_cell() {
    let table = table();
    assert_eq!(
        table.text(),
        "A table\n   what           ms\n   a, \"b\"       1.23\n*  long | name     -\n  x < y\n"
    );
    assert_eq!(
        String::from_utf8(table.csv().unwrap()).unwrap(),
        "what,ms\n\"a, \"\"b\"\"\",1.23456\nlong | name,\n"
    );
    assert!(table.markdown().contains("| long \\| name | - |"));
    let html = table.html();
    assert!(html.contains("x &lt; y") && html.contains("<tr class=\"marked\">"));
}

#[test]
#[should_panic(expected = "row of table `t`")]
fn rows_must_fit() {
    table().row(vec![Cell::Missing]);
}
