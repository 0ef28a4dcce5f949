//! Opens an adapter, where there is one.

use sinew_adapter::{AdapterError, AdapterRequest, list, open};

#[test]
fn listed_adapters_can_be_opened_by_name() {
    let found = list();
    let Some(first) = found.first() else {
        assert_eq!(open(&AdapterRequest::default()).err(), Some(AdapterError::NoneFound));
        eprint_skipped();
        return;
    };
    let gpu = open(&AdapterRequest { name: Some(first.name.clone()), ..Default::default() });
    // SINEW_ADAPTER may name another one.
    let gpu = gpu.unwrap();
    assert!(found.contains(&gpu.summary));
    assert_eq!(gpu.timestamps, gpu.device.features().contains(wgpu::Features::TIMESTAMP_QUERY));
    let soft = first.software();
    if std::env::var(sinew_adapter::ADAPTER_VARIABLE).is_err()
        && found.iter().all(|s| s.software() == soft)
    {
        let wrong = AdapterRequest { software: Some(!soft), ..Default::default() };
        assert!(matches!(open(&wrong), Err(AdapterError::NoMatch { .. })));
    }
}

#[allow(clippy::print_stderr, reason = "a skipped test says so")]
fn eprint_skipped() {
    eprintln!("skipped: no GPU adapter");
}
