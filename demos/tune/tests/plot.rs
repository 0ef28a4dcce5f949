//! Charts of recorded runs.

use sinew_tune::plot::{charts, write};
use std::path::PathBuf;

fn table(name: &str, text: &str) -> PathBuf {
    let path = std::env::temp_dir().join(format!("sinew-plot-{}-{name}.csv", std::process::id()));
    std::fs::write(&path, text).unwrap();
    path
}

#[test]
fn runs_are_drawn_over_each_other_forces_first() {
    let one = "step,time_s,inverted,a.depth (m),\"a, b.tool_force_x (N)\",\"a, b.tool_force_y (N)\"\n\
               0,0,0,0,0,0\n1,0.5,0,0.1,1,\n2,1,0,0.2,3,-2\n";
    let other = "step,time_s,inverted,a.depth (m)\n0,0,0,0\n1,2,0,0.4\n";
    let files = [table("one", one), table("other", other)];
    let found = charts(&files, &[]).unwrap();
    let names: Vec<&str> = found.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["a, b.tool force (N)", "a.depth (m)"]);
    // two parts of one run; the value that is missing is no point
    let [force, depth] = [0, 1].map(|i| &found[i].1.svg);
    assert_eq!(force.matches("<polyline").count(), 2, "{force}");
    let points = |svg: &str, line: usize| {
        let list = svg.split("points=\"").nth(line + 1).unwrap().split('"').next().unwrap();
        list.split_whitespace().count()
    };
    assert_eq!([points(force, 0), points(force, 1)], [3, 2], "{force}");
    assert_eq!(depth.matches("<polyline").count(), 2, "{depth}");
    assert!(depth.contains("-other</text>") && depth.contains("#d55e00"), "{depth}");
    // both lines end at the right, where the second run ends: the first one half of the way
    let last = |line: usize| -> f64 {
        let list = depth.split("points=\"").nth(line + 1).unwrap().split('"').next().unwrap();
        list.split_whitespace().last().unwrap().split(',').next().unwrap().parse().unwrap()
    };
    assert!((last(0) - 68.0 - 0.5 * (last(1) - 68.0)).abs() < 0.2, "{depth}");
    for end in ["svg", "html"] {
        let out = files[0].with_extension(end);
        write(&out, &files, &found).unwrap();
        let text = std::fs::read_to_string(&out).unwrap();
        assert_eq!(text.matches("<polyline").count(), 4, "{end}");
        std::fs::remove_file(out).unwrap();
    }
    let energies = charts(&files[..1], &["inverted".into()]).unwrap();
    assert_eq!(energies[0].0, "inverted");
    let nothing = charts(&files, &["x_y".into()]).err().unwrap().to_string();
    assert!(nothing.contains("columns: step, time_s, inverted"), "{nothing}");
    files.iter().for_each(|file| std::fs::remove_file(file).unwrap());
    assert!(charts(&files, &[]).err().unwrap().to_string().contains("-one.csv"));
}
