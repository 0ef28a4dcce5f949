//! Axes of every kind, for these tests and those of the device.

use sinew::engine::mesh::Mesh;
use sinew::models::axes::description::{AxesDescription, AxisAngle, AxisFamily, FibreForm};
use sinew::models::axes::field;
use sinew::models::axes::muscle::MuscleSettings;

/// Five families that are not orthogonal, two of them active and one biquadratic, six angles: triads, fibres and a term
/// of volume, some elements without a share.
pub fn rich(mesh: &Mesh) -> AxesDescription<'static> {
    let n = mesh.tetrahedra.len() + mesh.hexahedra.len();
    let fields: Vec<_> = (0..5).map(|i| field::random(mesh, i).directions).collect();
    let family = |name, i: usize, modulus| AxisFamily::new(name, &fields[i], modulus);
    let muscle = MuscleSettings {
        peak_stress: 4e3,
        optimal_stretch: 1.05,
        stiffening: 0.5,
        shortening: 0.1,
        ..MuscleSettings::default()
    };
    let share: Vec<f64> = (0..n).map(|i| (i % 3) as f64 * 0.5).collect();
    let other: Vec<f64> = (0..n).map(|i| (i % 4) as f64 * 0.4).collect();
    let angle = |families, modulus| AxisAngle { families, modulus };
    AxesDescription {
        families: vec![
            family("a", 0, 3e3),
            family("b", 1, 8e3),
            AxisFamily { muscle: Some(muscle.clone()), ..family("c", 2, 2e3) },
            AxisFamily { muscle: Some(muscle), share: Some(share.into()), ..family("d", 3, 1e3) },
            AxisFamily {
                form: FibreForm::Biquadratic,
                share: Some(other.into()),
                ..family("e", 4, 6e3)
            },
        ],
        angles: vec![
            angle([0, 1], 1e3),
            angle([2, 0], 2e3),
            angle([1, 2], 5e2),
            angle([1, 3], 7e2),
            angle([4, 2], 4e2),
            angle([3, 0], 9e2),
        ],
        volume_modulus: 6e3,
    }
    .into_owned()
}
