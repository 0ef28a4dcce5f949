//! Reports as dictionaries, which `package/sinew/_types.py` makes dataclasses of.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use sinew_embed::{BodyContactReport, PartReport, PullReport, ToolReport};

/// A dictionary of fields of a report.
macro_rules! dict {
    ($py:expr, $own:expr, [$($vector:ident)*], [$($plain:ident)*]) => {{
        let dict = PyDict::new($py);
        $(dict.set_item(stringify!($vector), $own.$vector.to_array())?;)*
        $(dict.set_item(stringify!($plain), $own.$plain)?;)*
        dict
    }};
}

fn part<'py>(py: Python<'py>, own: &PartReport) -> PyResult<Bound<'py, PyDict>> {
    Ok(dict!(py, own, [force torque], [depth sticking slipping]))
}

pub fn tool<'py>(py: Python<'py>, own: &ToolReport) -> PyResult<Bound<'py, PyDict>> {
    let dict = dict!(
        py, own,
        [position rotation velocity angular_velocity force torque normal friction centre],
        [opening work dissipation energy area depth pressure sticking slipping lag drawn_in]
    );
    dict.set_item("other_points", own.other_points.map(|force| force.to_array()))?;
    // rows
    let stiffness = own.local_stiffness.map(|own| own.transpose().to_cols_array_2d());
    dict.set_item("local_stiffness", stiffness)?;
    let parts: PyResult<Vec<_>> = own.parts.iter().map(|own| part(py, own)).collect();
    dict.set_item("parts", parts?)?;
    Ok(dict)
}

pub fn contact<'py>(py: Python<'py>, own: &BodyContactReport) -> PyResult<Bound<'py, PyDict>> {
    Ok(dict!(py, own, [force], [area depth dissipation sticking slipping]))
}

pub fn pull<'py>(py: Python<'py>, own: &PullReport) -> PyResult<Bound<'py, PyDict>> {
    Ok(dict!(py, own, [force torque], [distance work]))
}
