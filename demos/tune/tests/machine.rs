//! The machine and its load.

use sinew_tune::machine::{CoreTimes, Load, MachineNotes};

#[test]
fn a_busy_machine_is_said_so() {
    let quiet = Load {
        wall_s: 1.0,
        load_before: Some(0.1),
        load_after: Some(1.0),
        others: Some(0.01),
        stolen: Some(0.0),
        waiting: Some(0.001),
    };
    assert_eq!(quiet.warning(2), None);
    let busy = Load { others: Some(0.5), waiting: Some(0.3), ..quiet };
    let warning = busy.warning(2).unwrap();
    assert!(warning.contains("1.00 of the 2 cores") && warning.contains("30 %"), "{warning}");
    let untold = Load { others: None, stolen: None, waiting: None, ..quiet };
    assert_eq!(untold.warning(2), None);
}

#[test]
fn core_times_are_read() {
    let times = CoreTimes::parse("cpu  10 1 4 80 5 0 0 2 0 0").unwrap();
    assert_eq!((times.busy, times.stolen, times.total), (15, 2, 102));
    assert!(CoreTimes::parse("cpu 1 2").is_none());
}

#[test]
fn this_machine_has_a_line() {
    let notes = MachineNotes::now();
    assert!(notes.cores > 0 && notes.line().contains(&notes.sinew));
    assert!(notes.date.starts_with("20"), "{}", notes.date);
}
