//! The table as a Parquet file, by the low-level column writer.

use super::error::SweepError;
use super::merge::{Cells, SweepTable};
use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;
use std::path::Path;
use std::sync::Arc;

/// The file of a table; what has no value is null.
pub(super) fn bytes(table: &SweepTable, path: &Path) -> Result<Vec<u8>, SweepError> {
    written(table)
        .map_err(|error| SweepError::Table { path: path.into(), message: error.to_string() })
}

fn written(table: &SweepTable) -> Result<Vec<u8>, ParquetError> {
    let fields = table.columns.iter().map(|column| {
        let (physical, logical) = match column.cells {
            Cells::Number(_) => (Physical::DOUBLE, None),
            Cells::Text(_) => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
        };
        let field = Type::primitive_type_builder(&column.name, physical)
            .with_repetition(Repetition::OPTIONAL)
            .with_logical_type(logical);
        field.build().map(Arc::new)
    });
    let fields = fields.collect::<Result<Vec<_>, _>>()?;
    let schema = Arc::new(Type::group_type_builder("sweep").with_fields(fields).build()?);
    let properties = Arc::new(WriterProperties::builder().build());
    let mut writer = SerializedFileWriter::new(Vec::new(), schema, properties)?;
    let mut rows = writer.next_row_group()?;
    for column in &table.columns {
        let mut out =
            rows.next_column()?.ok_or_else(|| ParquetError::General("no column".into()))?;
        match &column.cells {
            Cells::Number(cells) => {
                let values: Vec<f64> = cells.iter().flatten().copied().collect();
                out.typed::<DoubleType>().write_batch(&values, Some(&levels(cells)), None)?;
            }
            Cells::Text(cells) => {
                let values: Vec<ByteArray> =
                    cells.iter().flatten().map(|text| ByteArray::from(text.as_str())).collect();
                out.typed::<ByteArrayType>().write_batch(&values, Some(&levels(cells)), None)?;
            }
        }
        out.close()?;
    }
    rows.close()?;
    writer.into_inner()
}

/// 1 where there is a value.
fn levels<T>(cells: &[Option<T>]) -> Vec<i16> {
    cells.iter().map(|cell| i16::from(cell.is_some())).collect()
}

#[cfg(test)]
mod tests {
    use super::super::merge::Column;
    use super::*;
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::Field;

    #[test]
    fn a_reader_finds_names_numbers_texts_and_gaps() {
        let numbers = Cells::Number(vec![Some(0.1), None, Some(-3e300)]);
        let texts =
            Cells::Text(vec![None, Some("Gewebe, \"weich\" é".into()), Some(String::new())]);
        let column = |name: &str, cells| Column { name: name.into(), cells };
        let table = SweepTable {
            columns: vec![column("scene.dt", numbers), column("error", texts)],
            parameters: 0..1,
            results: 1..2,
        };
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
            let found: Vec<_> =
                row.get_column_iter().map(|(n, f)| (n.clone(), f.clone())).collect();
            let [dt, error] = expected;
            assert_eq!(found, [("scene.dt".to_string(), dt), ("error".to_string(), error)]);
        }
    }
}
