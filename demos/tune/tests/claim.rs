//! Claims of shards.

use sinew_tune::sweep::SweepError;
use sinew_tune::sweep::claim::{Claim, ClaimOptions};
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("sinew-claim-{name}-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    folder
}

#[test]
fn a_claim_is_refused_while_its_process_lives_and_taken_over_when_it_is_dead() {
    let folder = folder("lives");
    let go = AtomicBool::new(false);
    let take = |stale| {
        let options =
            ClaimOptions { stale: Duration::from_millis(stale), ..ClaimOptions::default() };
        Claim::take(&folder, "0-of-2", options, &go)
    };
    let mut first = take(60_000).unwrap().unwrap();
    assert_eq!(first.number, 1);
    let refused = take(60_000).err().unwrap().to_string();
    assert!(refused.contains("shard 0/2") && refused.contains(&std::process::id().to_string()));
    // released
    first.beat().unwrap();
    first.release().unwrap();
    let mut second = take(60_000).unwrap().unwrap();
    assert_eq!(second.number, 2);
    // its process is gone: another with that number started at another time
    second.holder.start += 1;
    second.write().unwrap();
    let third = take(60_000).unwrap().unwrap();
    assert_eq!(third.number, 3);
    assert!(matches!(second.beat(), Err(SweepError::TakenOver { .. })));
    // another shard is free
    let other = Claim::take(&folder, "0-of-20", ClaimOptions::default(), &go).unwrap().unwrap();
    assert_eq!(other.number, 1);
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn a_claim_of_another_host_is_dead_when_its_heart_stands_still_and_only_then() {
    let folder = folder("stale");
    let go = AtomicBool::new(false);
    let options = ClaimOptions { stale: Duration::from_millis(600), ..ClaimOptions::default() };
    let mut far = Claim::take(&folder, "1-of-3", options, &go).unwrap().unwrap();
    far.holder.host = "far/boot/pid:[1]".into();
    far.write().unwrap();
    std::thread::scope(|scope| {
        let asks = scope.spawn(|| Claim::take(&folder, "1-of-3", options, &go));
        std::thread::sleep(Duration::from_millis(250));
        far.beat().unwrap();
        let refused = asks.join().unwrap().err().unwrap();
        assert!(refused.to_string().contains("on far"), "{refused}");
    });
    let start = Instant::now();
    let next = Claim::take(&folder, "1-of-3", options, &go).unwrap().unwrap();
    assert!(next.number == 2 && start.elapsed() >= options.stale);
    // what was cut off while it was made counts as well, and the wait for it is told
    std::fs::OpenOptions::new().write(true).open(next.path()).unwrap().set_len(3).unwrap();
    static TOLD: Mutex<Vec<String>> = Mutex::new(Vec::new());
    let options =
        ClaimOptions { told: Some(|why| TOLD.lock().unwrap().push(why.into())), ..options };
    assert_eq!(Claim::take(&folder, "1-of-3", options, &go).unwrap().unwrap().number, 3);
    let told = TOLD.lock().unwrap();
    assert_eq!(told.len(), 1);
    assert!(told[0].contains("shard 1/3") && told[0].contains("up to 0.6 s"), "{told:?}");
    std::fs::remove_dir_all(folder).unwrap();
}
