//! Lines of results, and shards.

use sinew_tune::sweep::record::{Shard, SweepRow, checked, line};

#[test]
fn lines_are_read_back_and_damage_is_noticed() {
    let row = SweepRow {
        id: "ab".into(),
        attempt: 0,
        error: Some("a \"quoted\"}\n line, \"check\":\"".into()),
        warnings: String::new(),
        steps: 5,
        state: "cd".into(),
        values: vec![Some(0.1 + 0.2), None, Some(-1e-300)],
        file: None,
    };
    let text = line(&row);
    let again: SweepRow = serde_json::from_str(&checked(text.as_bytes()).unwrap()).unwrap();
    assert_eq!(again, row);
    assert_eq!(text.matches('\n').count(), 1);
    for cut in 0..text.len() {
        assert!(checked(&text.as_bytes()[..cut]).is_none(), "{cut}");
    }
    for place in 0..text.len() {
        let mut bytes = text.clone().into_bytes();
        bytes[place] ^= 1;
        assert!(checked(&bytes).is_none(), "{place}");
    }
}

#[test]
fn shards_are_read() {
    assert_eq!("3/40".parse::<Shard>().unwrap(), Shard { index: 3, count: 40 });
    for bad in ["", "3", "3/3", "-1/3", "1/0", "a/b", "1/2/3"] {
        let error = bad.parse::<Shard>().unwrap_err().to_string();
        assert!(error.contains("for example 3/40"), "{error}");
    }
}
