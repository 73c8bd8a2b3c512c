//! Troubles of the sensors and of their wires that last for a time.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use anyhow::{Context, Result, bail};

const NS_PER_MS: u64 = 1_000_000;

/// A disturbance of the sensors, their buses or the port. A side is 0 for the left sensor and 1 for the right one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trouble {
    /// The sensor has no power.
    Absent(usize),
    /// Another chip is in its place, which answers at the same address.
    OtherChip(usize),
    /// Its bus is stuck: SDA is held low.
    SdaLow(usize),
    /// The clock of sensors and port is stuck.
    ClockStuck,
    /// The wire that tells valid lines is stuck.
    LvldLow,
}

impl Trouble {
    const NAMED: [(&'static str, Self); 8] = [
        ("left-absent", Self::Absent(0)),
        ("right-absent", Self::Absent(1)),
        ("left-other-chip", Self::OtherChip(0)),
        ("right-other-chip", Self::OtherChip(1)),
        ("left-sda-low", Self::SdaLow(0)),
        ("right-sda-low", Self::SdaLow(1)),
        ("clock-stuck", Self::ClockStuck),
        ("lvld-low", Self::LvldLow),
    ];
}

/// All troubles of a run, each with its time.
#[derive(Debug, Clone, Default)]
pub struct Troubles {
    all: Arc<Vec<(Trouble, Range<u64>)>>,
    /// The latest time that the port has told, ns.
    latest_ns: Arc<AtomicU64>,
}

impl Troubles {
    /// Reads each as `WHAT:FROM_MS:TO_MS`.
    pub fn parse(texts: &[String]) -> Result<Self> {
        let all: Result<Vec<_>> = texts.iter().map(|text| parse(text)).collect();
        Ok(Self {
            all: Arc::new(all?),
            latest_ns: Arc::default(),
        })
    }

    /// Whether there is this trouble at the time, ns.
    pub fn are(&self, trouble: Trouble, at_ns: u64) -> bool {
        let mut all = self.all.iter();
        all.any(|(what, time)| *what == trouble && time.contains(&at_ns))
    }

    /// Whether there is this trouble now, as of the latest time that was told.
    pub fn are_now(&self, trouble: Trouble) -> bool {
        self.are(trouble, self.latest_ns.load(Ordering::Relaxed))
    }

    /// Tells the time, ns.
    pub fn tell(&self, now_ns: u64) {
        self.latest_ns.store(now_ns, Ordering::Relaxed);
    }
}

fn parse(text: &str) -> Result<(Trouble, Range<u64>)> {
    let parts: Vec<&str> = text.split(':').collect();
    let [what, from, to] = parts[..] else {
        bail!("{text}: a trouble is WHAT:FROM_MS:TO_MS");
    };
    let mut named = Trouble::NAMED.into_iter();
    let (_, trouble) = named.find(|(name, _)| *name == what).with_context(|| {
        format!(
            "{text}: there is {:?}",
            Trouble::NAMED.map(|(name, _)| name)
        )
    })?;
    let ns = |ms: &str| anyhow::Ok(ms.parse::<u64>()?.saturating_mul(NS_PER_MS));
    Ok((trouble, ns(from)?..ns(to)?))
}
