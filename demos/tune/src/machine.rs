//! What the figures were measured on, and whether anything else ran meanwhile.

use serde::{Deserialize, Serialize};
use sinew_scene::summary::{Machine, Versions};
use std::fs::read_to_string;
use std::time::{Instant, SystemTime};

/// The machine and the program.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MachineNotes {
    /// Processor, where the system tells.
    pub processor: Option<String>,
    /// Cores (hardware threads) available to this process.
    pub cores: usize,
    /// Vector instruction sets found at run time.
    pub instruction_sets: Vec<String>,
    /// First-level data, second- and third-level cache (KiB), where the system tells.
    pub caches_kib: [Option<u64>; 3],
    /// Main memory (GiB), where the system tells.
    pub memory_gib: Option<f64>,
    /// Operating system, with its version where it tells.
    pub system: String,
    /// Processor family the program was compiled for.
    pub target: String,
    /// Version of Sinew.
    pub sinew: String,
    /// Compiler.
    pub rustc: String,
    /// Date and time (UTC, RFC 3339).
    pub date: String,
}

impl MachineNotes {
    /// This machine, now.
    pub fn now() -> Self {
        let memory = || {
            let text = read_to_string("/proc/meminfo").ok()?;
            let line = text.lines().find(|line| line.starts_with("MemTotal"))?;
            line.split_whitespace().nth(1)?.parse::<f64>().ok()
        };
        let (versions, machine) = (Versions::this(), Machine::this());
        let kernel = read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default();
        let system = format!("{} {}", std::env::consts::OS, kernel.trim());
        Self {
            processor: machine.processor,
            cores: machine.cores,
            instruction_sets: instruction_sets(),
            caches_kib: caches_kib(),
            memory_gib: memory().map(|kib| kib / 1024.0 / 1024.0),
            system: system.trim().to_string(),
            target: versions.target.to_string(),
            sinew: versions.sinew.to_string(),
            rustc: versions.rustc.to_string(),
            date: humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
        }
    }

    /// One line for reports.
    pub fn line(&self) -> String {
        let processor = self.processor.as_deref().unwrap_or("unknown processor");
        let memory = self.memory_gib.map_or(String::new(), |m| format!(", {m:.0} GiB"));
        format!(
            "{processor}, {} cores ({}){memory}, {}; Sinew {}, {}, {}",
            self.cores,
            self.instruction_sets.join(" "),
            self.system,
            self.sinew,
            self.rustc,
            self.date
        )
    }
}

#[cfg(target_arch = "x86_64")]
fn instruction_sets() -> Vec<String> {
    let found = [
        ("sse2", true),
        ("avx2", std::is_x86_feature_detected!("avx2")),
        ("fma", std::is_x86_feature_detected!("fma")),
        ("avx512f", std::is_x86_feature_detected!("avx512f")),
    ];
    found.into_iter().filter(|(_, there)| *there).map(|(name, _)| name.to_string()).collect()
}

#[cfg(not(target_arch = "x86_64"))]
fn instruction_sets() -> Vec<String> {
    vec![std::env::consts::ARCH.to_string()]
}

/// Data caches of the first core, as Linux lists them.
fn caches_kib() -> [Option<u64>; 3] {
    let mut caches = [None; 3];
    for index in 0..8 {
        let read = |name: &str| {
            let file = format!("/sys/devices/system/cpu/cpu0/cache/index{index}/{name}");
            read_to_string(file).ok().map(|text| text.trim().to_string())
        };
        let (Some(kind), Some(level), Some(size)) = (read("type"), read("level"), read("size"))
        else {
            continue;
        };
        let size = match size.strip_suffix('M') {
            Some(mib) => mib.parse().ok().map(|n: u64| n * 1024),
            None => size.trim_end_matches('K').parse().ok(),
        };
        if let (true, Ok(level @ 1..=3)) = (kind != "Instruction", level.parse::<usize>()) {
            caches[level - 1] = size;
        }
    }
    caches
}

/// Load of the machine over a stretch of time. Shares are of all cores together, 0 to 1; `None` where
/// the system does not tell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Load {
    /// Length (s).
    pub wall_s: f64,
    /// Load average (busy threads) of the minute before the start.
    pub load_before: Option<f64>,
    /// Load average of the minute before the end; this process is part of it.
    pub load_after: Option<f64>,
    /// Time that other processes had the cores.
    pub others: Option<f64>,
    /// Time that the host kept from a virtual machine.
    pub stolen: Option<f64>,
    /// Share of the measuring thread's time that it was ready to run but had no core: wall time
    /// above its own processor time.
    pub waiting: Option<f64>,
}

impl Load {
    /// What a reader of the figures must know, if anything.
    pub fn warning(&self, cores: usize) -> Option<String> {
        let mut found = Vec::new();
        // a tenth of one core is the usual noise of a desktop
        if let Some(others) = self.others.filter(|x| x * cores as f64 > 0.1) {
            found.push(format!(
                "other processes took {:.2} of the {cores} cores",
                others * cores as f64
            ));
        }
        if let Some(stolen) = self.stolen.filter(|x| *x > 0.02) {
            found.push(format!("the host kept {:.0} % of the cores' time", 100.0 * stolen));
        }
        if let Some(waiting) = self.waiting.filter(|x| *x > 0.02) {
            found.push(format!("the measuring thread waited {:.0} % of its time", 100.0 * waiting));
        }
        if found.is_empty() {
            return None;
        }
        Some(format!(
            "the machine was busy: {}; trust minima and ratios, not single medians",
            found.join(", ")
        ))
    }
}

/// Measures a [`Load`].
pub struct Watch {
    start: Instant,
    load: Option<f64>,
    cores: Option<CoreTimes>,
    own: Option<u64>,
    thread: Option<[u64; 2]>,
}

impl Watch {
    /// Starts; `finish` must be called on the same thread.
    pub fn start() -> Self {
        Self {
            start: Instant::now(),
            load: load_average(),
            cores: CoreTimes::read(),
            own: own_ticks(),
            thread: thread_times(),
        }
    }

    /// Load since the start.
    pub fn finish(&self) -> Load {
        let cores = CoreTimes::read().zip(self.cores).map(|(now, then)| now.since(then));
        let own = own_ticks().zip(self.own).map(|(now, then)| now.saturating_sub(then));
        let thread = thread_times().zip(self.thread);
        let share = |part: u64, whole: u64| (whole > 0).then(|| part as f64 / whole as f64);
        Load {
            wall_s: self.start.elapsed().as_secs_f64(),
            load_before: self.load,
            load_after: load_average(),
            others: cores.zip(own).and_then(|(c, own)| share(c.busy.saturating_sub(own), c.total)),
            stolen: cores.and_then(|c| share(c.stolen, c.total)),
            waiting: thread.and_then(|([run, wait], [run0, wait0])| {
                share(wait.saturating_sub(wait0), (run + wait).saturating_sub(run0 + wait0))
            }),
        }
    }
}

fn load_average() -> Option<f64> {
    read_to_string("/proc/loadavg").ok()?.split_whitespace().next()?.parse().ok()
}

/// Clock ticks of all cores together.
#[derive(Clone, Copy, Debug)]
pub struct CoreTimes {
    /// In programs.
    pub busy: u64,
    /// Taken by other machines.
    pub stolen: u64,
    /// All.
    pub total: u64,
}

impl CoreTimes {
    fn read() -> Option<Self> {
        Self::parse(read_to_string("/proc/stat").ok()?.lines().next()?)
    }

    /// From the line `cpu user nice system idle iowait irq softirq steal ...`.
    pub fn parse(line: &str) -> Option<Self> {
        let fields: Vec<u64> =
            line.split_whitespace().skip(1).take(8).map_while(|x| x.parse().ok()).collect();
        let &[user, nice, system, idle, io, irq, soft, stolen] = fields.as_slice() else {
            return None;
        };
        let busy = user + nice + system + irq + soft;
        Some(Self { busy, stolen, total: busy + idle + io + stolen })
    }

    fn since(self, then: Self) -> Self {
        Self {
            busy: self.busy.saturating_sub(then.busy),
            stolen: self.stolen.saturating_sub(then.stolen),
            total: self.total.saturating_sub(then.total),
        }
    }
}

/// Clock ticks of this process and of its children that have ended: `utime`, `stime`, `cutime` and
/// `cstime`, the 12th to 15th field after the name. Other engines run as children.
fn own_ticks() -> Option<u64> {
    let text = read_to_string("/proc/self/stat").ok()?;
    let fields = text.rsplit_once(')')?.1.split_whitespace().skip(11);
    fields.take(4).map(|ticks| ticks.parse::<u64>().ok()).sum()
}

/// Nanoseconds that this thread ran, and that it waited for a core.
fn thread_times() -> Option<[u64; 2]> {
    let text = read_to_string("/proc/thread-self/schedstat").ok()?;
    let mut fields = text.split_whitespace().map(|x| x.parse().ok());
    Some([fields.next()??, fields.next()??])
}
