//! A live picture of an instance in a terminal. It requests nothing of the robot. It reads the status of
//! `control`, and the joints from shared memory if this user has access.

use bus::{Domain, Reader};
use explain::{Severity, calibration_name, mode_name, sentences};
use instance::Instance;
use messages::{Faults, JOINTS_MAX, Mode, RobotState, Service, Status};
use operator::{Client, OperatorError};
use ratatui::Frame;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyModifiers};
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style, Stylize};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Paragraph, Sparkline, Wrap};
use robot::Names;
use rt::err;
use std::collections::VecDeque;
use std::path::Path;
use std::time::{Duration, Instant};

/// Time between two pictures. A terminal over a network can show ten a second.
const LOOK: Duration = Duration::from_millis(100);
/// Time over which the tick rate is measured.
const RATE_OVER: Duration = Duration::from_secs(1);
/// Number of ages drawn: half a minute.
const AGES_KEPT: usize = 300;
/// Number of event sentences kept.
const EVENTS_KEPT: usize = 100;
/// A joint closer to a limit than this share of its range is marked.
const NEAR: f64 = 0.03;

/// Draws until q, Esc or Ctrl-C.
pub fn run(client: &mut Client, run_dir: &Path) -> Result<bool, OperatorError> {
    let instance = Instance::unmade(run_dir);
    let mut shown = Shown::new(instance::read_names(run_dir));
    let mut joints = Joints::open(&instance);
    let mut terminal = match ratatui::try_init() {
        Ok(terminal) => terminal,
        Err(error) => {
            err!("teleopctl: cannot draw in this terminal: {error}");
            return Ok(false);
        }
    };
    let outcome = loop {
        match client.heartbeat() {
            Ok(status) => shown.update(status, joints.as_mut().and_then(Joints::look), Instant::now()),
            Err(OperatorError::Timeout { .. }) => shown.silent = true,
            // Another client displaced this connection. Connect again.
            Err(error) => match Client::connect(instance.operator_socket()) {
                Ok(new) => (*client, shown.silent) = (new, true),
                Err(_) => break Err(error),
            },
        }
        if terminal.draw(|frame| shown.draw(frame)).is_err() || wants_to_end() {
            break Ok(true);
        }
    };
    ratatui::restore();
    outcome
}

/// Waits for the next picture. Returns true if the user pressed a key that ends it.
fn wants_to_end() -> bool {
    let give_up = Instant::now() + LOOK;
    loop {
        let left = give_up.saturating_duration_since(Instant::now());
        match event::poll(left) {
            Ok(false) => return false,
            Ok(true) => match event::read() {
                Ok(Event::Key(KeyEvent { code: KeyCode::Char('q') | KeyCode::Esc, .. })) => return true,
                Ok(Event::Key(KeyEvent { code: KeyCode::Char('c'), modifiers, .. }))
                    if modifiers.contains(KeyModifiers::CONTROL) =>
                {
                    return true;
                }
                Ok(_) => {}
                Err(_) => return true,
            },
            Err(_) => return true,
        }
    }
}

/// Measured joints, for users who share memory with the instance.
struct Joints {
    states: Reader<RobotState>,
    latest: Option<RobotState>,
    _domain: Domain,
}

impl Joints {
    fn open(instance: &Instance) -> Option<Self> {
        // Create nothing if no instance is there.
        instance.run_dir().join("core").is_dir().then_some(())?;
        let domain = Domain::open(instance.core_domain(), "watch").ok()?;
        Some(Self { states: domain.reader(Service::RobotState).ok()?, latest: None, _domain: domain })
    }

    fn look(&mut self) -> Option<Vec<f64>> {
        self.latest = self.states.latest().or(self.latest);
        self.latest.map(|state| own(&state).to_vec())
    }
}

fn own(state: &RobotState) -> &[f64] {
    &state.q_measured[..(state.robot.joint_count as usize).min(JOINTS_MAX)]
}

struct Shown {
    names: Names,
    status: Option<Status>,
    q: Option<Vec<f64>>,
    silent: bool,
    ages_us: VecDeque<u64>,
    events: VecDeque<(Severity, String)>,
    counted: Option<(Instant, u64)>,
    rate_hz: f64,
}

impl Shown {
    fn new(names: Names) -> Self {
        let (ages_us, events) = (VecDeque::new(), VecDeque::new());
        Self { names, status: None, q: None, silent: false, ages_us, events, counted: None, rate_hz: 0.0 }
    }

    fn update(&mut self, status: Status, q: Option<Vec<f64>>, now: Instant) {
        for sentence in sentences(self.status.as_ref(), &status, &self.names) {
            self.events.push_front((sentence.gravity, sentence.text));
        }
        self.events.truncate(EVENTS_KEPT);
        self.ages_us.push_back(explain::input_age_ms(&status).map_or(0, |ms| (ms * 1e3) as u64));
        if self.ages_us.len() > AGES_KEPT {
            self.ages_us.pop_front();
        }
        let (since, ticks) = *self.counted.get_or_insert((now, status.ticks));
        let passed = now.saturating_duration_since(since);
        if passed >= RATE_OVER {
            self.rate_hz = status.ticks.saturating_sub(ticks) as f64 / passed.as_secs_f64();
            self.counted = Some((now, status.ticks));
        }
        (self.status, self.q, self.silent) = (Some(status), q, false);
    }

    fn draw(&self, frame: &mut Frame<'_>) {
        let Some(status) = &self.status else {
            return frame.render_widget(Paragraph::new("control does not answer yet"), frame.area());
        };
        // With this height, a bar for each joint fits into 24 rows.
        let of_why = if frame.area().height < 25 { 2 } else { 3 };
        let rows = Layout::vertical([
            Constraint::Length(1),
            Constraint::Length(of_why),
            Constraint::Length(3),
            Constraint::Fill(1),
            Constraint::Length(1),
        ]);
        let [head, why, age, body, foot] = rows.areas(frame.area());
        frame.render_widget(self.head(status), head);
        frame.render_widget(Paragraph::new(explain::why(status, &self.names)).wrap(Wrap { trim: true }), why);
        self.draw_age(frame, age);
        let figures = Paragraph::new(self.figures(status)).wrap(Wrap { trim: true });
        let count = self.q.as_ref().map_or(1, Vec::len);
        if count <= usize::from(body.height) {
            let [left, right] = Layout::horizontal([Constraint::Percentage(50), Constraint::Fill(1)]).areas(body);
            frame.render_widget(Paragraph::new(self.joints(left.width)), left);
            frame.render_widget(figures, right);
        } else {
            let [joints, below] =
                Layout::vertical([Constraint::Length(count.div_ceil(2) as u16), Constraint::Fill(1)]).areas(body);
            self.draw_in_two_columns(frame, joints);
            frame.render_widget(figures, below);
        }
        frame.render_widget(Line::from("q ends").dim(), foot);
    }

    fn head(&self, status: &Status) -> Line<'static> {
        let mode = Mode::from_u32(status.mode);
        let colour = match mode {
            Some(Mode::Engaged) => Color::Green,
            Some(Mode::Disengaged) => Color::Reset,
            Some(Mode::Engaging | Mode::Holding | Mode::Recovering) => Color::Yellow,
            Some(Mode::Faulted) | None => Color::Red,
        };
        let rest = format!(
            "  {:.0} Hz, {} of {} deadlines missed, {}, {} operators{}",
            self.rate_hz,
            status.missed_deadlines,
            status.ticks,
            if status.realtime == 1 { "real-time" } else { "no real-time" },
            status.operators,
            if self.silent { "; control does not answer" } else { "" },
        );
        Line::from(vec![Span::styled(mode_name(status.mode), Style::new().fg(colour).bold()), Span::raw(rest)])
    }

    fn draw_age(&self, frame: &mut Frame<'_>, area: Rect) {
        let [words, chart] = Layout::horizontal([Constraint::Length(24), Constraint::Fill(1)]).areas(area);
        let newest = self.ages_us.back().map_or(0.0, |&us| us as f64 * 1e-3);
        let most = self.ages_us.iter().max().map_or(0.0, |&us| us as f64 * 1e-3);
        let words_text = vec![
            Line::from("age of the skeleton"),
            Line::from(format!("{newest:.1} ms")).bold(),
            Line::from(format!("at most {most:.1} ms")).dim(),
        ];
        frame.render_widget(Paragraph::new(words_text), words);
        let fits = self.ages_us.len().saturating_sub(usize::from(chart.width));
        let newest: Vec<u64> = self.ages_us.iter().skip(fits).copied().collect();
        frame.render_widget(Sparkline::default().data(&newest), chart);
    }

    /// Draws the joints in two columns. The last place says how many do not fit.
    fn draw_in_two_columns(&self, frame: &mut Frame<'_>, area: Rect) {
        let columns: [Rect; 2] = Layout::horizontal([Constraint::Percentage(50), Constraint::Fill(1)]).areas(area);
        let height = usize::from(area.height);
        let mut bars = self.joints(columns[0].width.min(columns[1].width));
        if bars.len() > 2 * height && height > 0 {
            let fit = 2 * height - 1;
            let left_out = format!("{} more joints: use a higher window", bars.len() - fit);
            bars.truncate(fit);
            bars.push(Line::from(left_out).dim());
        }
        let right = bars.split_off(bars.len().div_ceil(2));
        frame.render_widget(Paragraph::new(bars), columns[0]);
        frame.render_widget(Paragraph::new(right), columns[1]);
    }

    /// Returns a bar for each joint, from its lowest to its highest position.
    fn joints(&self, width: u16) -> Vec<Line<'static>> {
        let Some(q) = &self.q else { return vec![Line::from("joints: only for the instance's user").dim()] };
        let names: Vec<String> = (0..q.len()).map(|j| self.names.joint(j)).collect();
        let longest = names.iter().map(String::len).max().unwrap_or_default();
        let bar = usize::from(width).saturating_sub(longest + 15).max(5);
        let rows = q.iter().enumerate().map(|(j, &q)| {
            let [low, high] = self.names.limits(j).unwrap_or([q - 1.0, q + 1.0]);
            let share = (q - low) / (high - low);
            let at = (share.clamp(0.0, 1.0) * (bar - 1) as f64).round() as usize;
            let drawn: String = (0..bar).map(|n| if n == at { '●' } else { '─' }).collect();
            let near = !(NEAR..=1.0 - NEAR).contains(&share);
            let style = if near { Style::new().fg(Color::Red) } else { Style::new() };
            let name = &names[j];
            Line::from(vec![
                Span::raw(format!("{name:<longest$} ")),
                Span::styled(drawn, style),
                Span::raw(format!(" {q:>7.3} {}", self.names.unit(j))),
            ])
        });
        rows.collect()
    }

    fn figures(&self, status: &Status) -> Vec<Line<'static>> {
        let mut lines = vec![
            Line::from(format!(
                "nearest: {}, {:.0} mm measured, {:.0} mm commanded",
                self.names.pair(status.nearest_pair_measured),
                status.clearance_measured_m * 1e3,
                status.clearance_command_m * 1e3
            )),
            Line::from(format!(
                "limb error {:.1} deg target, {:.1} deg measured; speed {:.0} %",
                status.limb_error_target_rad.to_degrees(),
                status.limb_error_measured_rad.to_degrees(),
                status.speed_scale * 100.0
            )),
            Line::from(format!("calibration: {}", calibration_name(status))),
            Line::from(format!("{} denied by the gate, {} fallbacks", status.gate_denials, status.fallbacks)),
        ];
        for fault in Faults(status.faults | status.latched).iter() {
            let latched = if Faults(status.latched).has(fault) { " (latched)" } else { "" };
            lines.push(Line::from(format!("{}{latched}", fault.row().name)).red());
        }
        lines.push(Line::from(""));
        lines.extend(self.events.iter().map(|(gravity, text)| {
            let line = Line::from(text.clone());
            match gravity {
                Severity::Note => line,
                Severity::Warning => line.yellow(),
                Severity::Error => line.red(),
            }
        }));
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::{Layout as _, Stamp, Transition};
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    fn shown(width: u16, height: u16, shown: &Shown) -> String {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        terminal.draw(|frame| shown.draw(frame)).unwrap();
        let buffer = terminal.backend().buffer();
        let rows = (0..height).map(|y| (0..width).map(|x| buffer[(x, y)].symbol()).collect::<String>() + "\n");
        rows.collect()
    }

    fn names() -> Names {
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/teleop.toml");
        Names::from_model(&config::load(&config, config::Overrides::default()).expect("settings").model)
    }

    fn status(mode: Mode, ticks: u64) -> Status {
        let mut status = Status::ZERO;
        (status.mode, status.ticks, status.realtime) = (mode as u32, ticks, 1);
        (status.header.stamp, status.input_age_ns) = (Stamp(10_000_000_000), 12_500_000);
        (status.target_stamp, status.clearance_measured_m) = (Stamp(9_999_000_000), 0.123);
        status
    }

    #[test]
    fn watch_screen_shows_mode_rate_age_joints_and_events() {
        let (mut watch, now) = (Shown::new(names()), Instant::now());
        let mut state = RobotState::ZERO;
        (state.robot.joint_count, state.q_measured) = (17, [0.1; JOINTS_MAX]);
        state.q_measured[0] = 0.2;
        let q = own(&state).to_vec();
        watch.update(status(Mode::Disengaged, 1000), Some(q.clone()), now);
        let mut engaged = status(Mode::Engaging, 2500);
        engaged.transition_count = 1;
        engaged.transitions[0].to = Mode::Engaging as u32;
        engaged.transitions[0].why = Transition::ENABLED;
        watch.update(engaged, Some(q), now + Duration::from_secs(1));
        let text = shown(140, 40, &watch);
        for part in ["Engaging", "1500 Hz", "12.5 ms", "torso_lift_joint", "0.200 m", "123 mm measured", "enabled", "●"]
        {
            assert!(text.contains(part), "{part}: {text}");
        }
        let bar = text.lines().find(|line| line.contains("torso_lift_joint")).unwrap();
        assert_eq!(bar.matches('●').count(), 1, "{bar}");
        // One bar for each joint of this robot, and none for the joints that the message has room for.
        assert_eq!(text.matches('●').count(), 17, "{text}");
        let ends = text.lines().filter(|line| line.contains('●')).map(|line| line.find('─'));
        assert!(ends.clone().all(|end| end == ends.clone().next().flatten()), "the bars begin together: {text}");
        watch.silent = true;
        assert!(shown(140, 40, &watch).contains("does not answer"));
    }

    #[test]
    fn watch_screen_of_24_rows_shows_every_joint() {
        let (mut watch, now) = (Shown::new(names()), Instant::now());
        for count in [17, 22, JOINTS_MAX] {
            watch.update(status(Mode::Engaged, 1000), Some(vec![0.1; count]), now);
            let text = shown(80, 24, &watch);
            assert_eq!(text.matches('●').count(), count, "{text}");
            assert!(text.contains("mm measured") && text.contains("0.100 m"), "{text}");
        }
        // A lower window says what it leaves out.
        let text = shown(80, 14, &watch);
        let drawn = text.matches('●').count();
        assert!(drawn < JOINTS_MAX && text.contains(&format!("{} more joints", JOINTS_MAX - drawn)), "{text}");
    }

    #[test]
    fn watch_screen_draws_in_any_terminal_size_without_panic() {
        let mut watch = Shown::new(Names::default());
        for (width, height) in [(1, 1), (10, 3), (40, 10), (300, 100)] {
            shown(width, height, &watch);
        }
        watch.update(status(Mode::Faulted, 1), None, Instant::now());
        for (width, height) in [(1, 1), (10, 3), (40, 10), (80, 24), (300, 100)] {
            shown(width, height, &watch);
        }
        assert!(shown(80, 24, &watch).contains("for the instance's user"));
        watch.update(status(Mode::Faulted, 1), Some(vec![f64::NAN; JOINTS_MAX]), Instant::now());
        shown(80, 24, &watch);
    }
}
