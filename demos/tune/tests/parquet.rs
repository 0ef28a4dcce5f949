//! The table of a sweep as a Parquet file, read back.

use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use sinew_tune::sweep::parquet::bytes;
use sinew_tune::sweep::table::SweepTable;
use sinew_tune::table::{Cell, Table};

#[test]
fn a_reader_finds_names_numbers_texts_and_gaps() {
    let mut cells = Table::new("runs", "Runs", &["scene.dt", "error"]);
    cells.row(vec![0.1.into(), Cell::Missing]);
    cells.row(vec![Cell::Missing, "Gewebe, \"weich\" é".into()]);
    cells.row(vec![(-3e300).into(), "".into()]);
    let table = SweepTable { cells, parameters: 0..2, results: 2..2 };
    let path = std::env::temp_dir().join(format!("sinew-{}.parquet", std::process::id()));
    std::fs::write(&path, bytes(&table, &path).unwrap()).unwrap();
    let reader = SerializedFileReader::new(std::fs::File::open(&path).unwrap()).unwrap();
    let rows: Vec<_> = reader.get_row_iter(None).unwrap().map(Result::unwrap).collect();
    std::fs::remove_file(&path).unwrap();
    let text = |value: &str| Field::Str(value.into());
    let expected = [
        [Field::Double(0.1), Field::Null],
        [Field::Null, text("Gewebe, \"weich\" é")],
        [Field::Double(-3e300), text("")],
    ];
    assert_eq!(rows.len(), expected.len());
    for (row, expected) in rows.iter().zip(expected) {
        let found: Vec<_> = row.get_column_iter().map(|(n, f)| (n.clone(), f.clone())).collect();
        let [dt, error] = expected;
        assert_eq!(found, [("scene.dt".to_string(), dt), ("error".to_string(), error)]);
    }
}
