//! The table as a Parquet file, by the low-level column writer.

use super::error::{Result, SweepError};
use super::table::SweepTable;
use crate::table::Cell;
use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;
use std::path::Path;
use std::sync::Arc;

/// The file of a table; what has no value is null. An error names `path`.
///
/// # Errors
/// When the writer refuses the table.
pub fn bytes(table: &SweepTable, path: &Path) -> Result<Vec<u8>> {
    written(table)
        .map_err(|error| SweepError::Table { path: path.into(), message: error.to_string() })
}

fn written(table: &SweepTable) -> Result<Vec<u8>, ParquetError> {
    let columns: Vec<Option<Vec<Option<f64>>>> =
        (0..table.cells.columns.len()).map(|column| table.numbers(column)).collect();
    let fields = table.cells.columns.iter().zip(&columns).map(|(name, numbers)| {
        let (physical, logical) = match numbers {
            Some(_) => (Physical::DOUBLE, None),
            None => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
        };
        let field = Type::primitive_type_builder(name, physical)
            .with_repetition(Repetition::OPTIONAL)
            .with_logical_type(logical);
        field.build().map(Arc::new)
    });
    let fields = fields.collect::<Result<Vec<_>, _>>()?;
    let schema = Arc::new(Type::group_type_builder("sweep").with_fields(fields).build()?);
    let properties = Arc::new(WriterProperties::builder().build());
    let mut writer = SerializedFileWriter::new(Vec::new(), schema, properties)?;
    let mut rows = writer.next_row_group()?;
    for (column, numbers) in columns.into_iter().enumerate() {
        let mut out =
            rows.next_column()?.ok_or_else(|| ParquetError::General("no column".into()))?;
        match numbers {
            Some(numbers) => {
                let values: Vec<f64> = numbers.iter().flatten().copied().collect();
                out.typed::<DoubleType>().write_batch(&values, Some(&levels(&numbers)), None)?;
            }
            None => {
                let cells = table.cells.rows.iter().map(|row| &row[column]);
                let text = |cell: &Cell| (*cell != Cell::Missing).then(|| cell.exact());
                let texts: Vec<Option<String>> = cells.map(text).collect();
                let values: Vec<ByteArray> =
                    texts.iter().flatten().map(|text| ByteArray::from(text.as_str())).collect();
                out.typed::<ByteArrayType>().write_batch(&values, Some(&levels(&texts)), None)?;
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
