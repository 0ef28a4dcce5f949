//! A haptic device without the hardware, in simulated time: for tests, and to try a scene before there is a device.

use glam::DVec3;
use std::collections::VecDeque;

/// Parts of a cycle in which the motion of the mass is integrated.
const PARTS: u32 = 20;
/// Time constant (s) of the filter of the velocity.
const FILTER: f64 = 1e-3;

/// A mass with a damper that renders forces some cycles late, read by an encoder, and a hand that may hold it.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatedDevice {
    /// Length of a cycle (s); a millisecond by default.
    pub cycle: f64,
    /// Moving mass (kg).
    pub mass: f64,
    /// Its own damping (N s/m).
    pub damping: f64,
    /// Step of the encoder (m); that of 16 bits over 0.2 m by default.
    pub count: f64,
    /// Stiffness (N/m) and damping (N s/m) of the hand; none lets it go.
    pub hand: Option<[f64; 2]>,
    /// Where the hand wants it (m).
    pub wish: DVec3,
    /// Where it is (m).
    pub position: DVec3,
    /// How fast it is (m/s).
    pub velocity: DVec3,
    /// Forces (N) on their way.
    late: VecDeque<DVec3>,
    /// Place (m) and velocity (m/s) as measured last.
    measured: [DVec3; 2],
}

impl SimulatedDevice {
    /// A device at rest at the origin that renders a force `delay` cycles after it was told, and that nobody holds.
    pub fn new(mass: f64, damping: f64, delay: usize) -> Self {
        Self {
            cycle: 1e-3,
            mass,
            damping,
            count: 0.2 / 65536.0,
            hand: None,
            wish: DVec3::ZERO,
            position: DVec3::ZERO,
            velocity: DVec3::ZERO,
            late: vec![DVec3::ZERO; delay].into(),
            measured: [DVec3::ZERO; 2],
        }
    }

    /// Held by a hand of a stiffness (N/m) and a damping (N s/m), which wants it where it is.
    #[must_use]
    pub fn held(self, stiffness: f64, damping: f64) -> Self {
        Self { hand: Some([stiffness, damping]), wish: self.position, ..self }
    }

    /// Place (m) and velocity (m/s) by encoder and filter, a cycle after the last ones.
    fn measure(&mut self) -> [DVec3; 2] {
        let [before, v] = self.measured;
        let x = (self.position / self.count).round() * self.count;
        let part = 1.0 - (-self.cycle / FILTER).exp();
        self.measured = [x, v + part * ((x - before) / self.cycle - v)];
        self.measured
    }

    /// Tells what it measures, and the force (N) that it renders now.
    fn render(&mut self, exchange: impl FnOnce(DVec3, DVec3, f64) -> DVec3) -> DVec3 {
        let [x, v] = self.measure();
        self.late.push_back(exchange(x, v, self.cycle));
        self.late.pop_front().unwrap_or_default()
    }

    /// A cycle at whose begin somebody has put it to a place (m). `exchange` gets position, velocity and time since the last
    /// call, and gives the force (N).
    pub fn put(&mut self, at: DVec3, exchange: impl FnOnce(DVec3, DVec3, f64) -> DVec3) {
        (self.position, self.velocity) = (at, DVec3::ZERO);
        self.render(exchange);
    }

    /// A cycle in which it goes where the forces take it.
    pub fn go(&mut self, exchange: impl FnOnce(DVec3, DVec3, f64) -> DVec3) {
        let rendered = self.render(exchange);
        let h = self.cycle / f64::from(PARTS);
        let [k, b] = self.hand.unwrap_or_default();
        for _ in 0..PARTS {
            let held = k * (self.wish - self.position) - b * self.velocity;
            self.velocity += h / self.mass * (rendered - self.damping * self.velocity + held);
            self.position += h * self.velocity;
        }
    }
}
