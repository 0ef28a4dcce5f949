//! One method against finite elements: a row of paper B's tables.

use serde::{Deserialize, Serialize};

use super::{
    Loading, SpringOptions, VirtualTestError, dimension, finite_elements, linear_springs,
    rest_length_springs,
};
use crate::cells::Cells;
use crate::error_metrics::{PositionErrors, position_errors};
use crate::kind::ElementMethod;
use crate::material::{LinearMaterial, Section};
use crate::mesh::{FitReport, fit_elements};

/// A mesh, its materials and a loading.
#[derive(Clone, Copy, Debug)]
pub struct VirtualTest<'a> {
    /// Rest positions, m.
    pub points: &'a [[f64; 3]],
    /// Elements.
    pub cells: Cells<'a>,
    /// One material, or one for each element.
    pub materials: &'a [LinearMaterial],
    /// Section of plane elements.
    pub section: Section,
    /// What is held and what pulls.
    pub loading: &'a Loading,
}

/// How springs are to be understood.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SpringModel {
    /// With their stiffness at rest: paper B's model.
    Linear,
    /// With rest lengths, at finite displacement.
    RestLength(SpringOptions),
}

/// Springs of one method against finite elements.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// How the springs were found.
    pub springs: FitReport,
    /// Errors in percent of the largest displacement of the reference.
    pub errors: PositionErrors,
    /// Displacements of the springs, m.
    pub displacements: Vec<[f64; 3]>,
    /// Whether their stiffness is positive definite.
    pub definite: bool,
}

impl VirtualTest<'_> {
    /// Displacements (m) of linear finite elements, the reference.
    ///
    /// # Errors
    /// [`VirtualTestError`].
    pub fn finite_elements(&self) -> Result<Vec<[f64; 3]>, VirtualTestError> {
        finite_elements(self.points, &self.cells, self.materials, &self.section, self.loading)
    }

    /// Fits springs by `method`, loads them as `model` and compares them with the displacements
    /// `reference` (m).
    ///
    /// # Errors
    /// [`VirtualTestError`].
    ///
    /// ```
    /// use sinew_identify::cells::Cells;
    /// use sinew_identify::virtual_test::Loading;
    /// use sinew_identify::virtual_test::comparison::{SpringModel, VirtualTest};
    /// use sinew_identify::{ElementMethod, LinearMaterial, Section};
    ///
    /// // equilateral triangle, nu = 1/3: springs are exact
    /// let points = [[0.0; 3], [1.0, 0.0, 0.0], [0.5, 0.75f64.sqrt(), 0.0]];
    /// let mut loading = Loading { forces: vec![(2, [0.1, 0.2, 0.0])], ..Loading::default() };
    /// loading.hold(&[0, 1], 2, [0.0; 3]);
    /// let test = VirtualTest {
    ///     points: &points,
    ///     cells: Cells { triangles: &[[0, 1, 2]], ..Cells::default() },
    ///     materials: &[LinearMaterial::new(1.0, 1.0 / 3.0)?],
    ///     section: Section::default(),
    ///     loading: &loading,
    /// };
    /// let reference = test.finite_elements()?;
    /// let row = test.compare(&reference, ElementMethod::Frobenius, SpringModel::Linear)?;
    /// assert!(row.errors.max_percent < 1e-10 && row.definite);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn compare(
        &self,
        reference: &[[f64; 3]],
        method: ElementMethod,
        model: SpringModel,
    ) -> Result<Comparison, VirtualTestError> {
        let dimension = dimension(self.points, &self.cells)?;
        let springs =
            fit_elements(self.points, &self.cells, self.materials, &self.section, method)?;
        let (edges, constants) = (&springs.edges, &springs.constants);
        let solution = match model {
            SpringModel::Linear => {
                linear_springs(self.points, edges, constants, dimension, self.loading)?
            }
            SpringModel::RestLength(options) => rest_length_springs(
                self.points,
                edges,
                constants,
                dimension,
                self.loading,
                &options,
            )?,
        };
        let place = |u: &[[f64; 3]]| -> Vec<[f64; 3]> {
            let moved = self.points.iter().zip(u);
            moved.map(|(x, u)| [x[0] + u[0], x[1] + u[1], x[2] + u[2]]).collect()
        };
        let found = place(&solution.displacements);
        let errors = position_errors(self.points, &place(reference), &found)?;
        Ok(Comparison {
            springs: springs.report,
            errors,
            displacements: solution.displacements,
            definite: solution.definite,
        })
    }
}
