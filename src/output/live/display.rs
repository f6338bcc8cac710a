//! The display of a live run on a terminal: rate, drops, latency bars per node, and the latest map.

use std::io::{self, Stderr, Write as _};

use depthloom_graphs::Value;
use depthloom_runner::{LiveStatus, Phase, StepLatency};
use ratatui::backend::CrosstermBackend;
use ratatui::crossterm::cursor::{Hide, Show};
use ratatui::crossterm::execute;
use ratatui::crossterm::terminal::{EnterAlternateScreen, LeaveAlternateScreen};
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Paragraph};
use ratatui::{Frame, Terminal};

use super::picture::Picture;

/// The display, as long as it is shown. Dropping it restores the terminal.
pub(super) struct Display {
    terminal: Terminal<CrosstermBackend<Stderr>>,
    stage: String,
    message: String,
}

impl Display {
    /// Takes the terminal over.
    ///
    /// # Errors
    /// If the terminal cannot be drawn on.
    pub(super) fn start(stage: &str) -> io::Result<Self> {
        let mut stderr = io::stderr();
        // Keys are not read, so the terminal keeps its mode, and Ctrl-C sends its signal.
        execute!(stderr, EnterAlternateScreen, Hide)?;
        match Terminal::new(CrosstermBackend::new(stderr)) {
            Ok(terminal) => {
                let mut display = Self { terminal, stage: stage.to_owned(), message: String::new() };
                display.terminal.clear()?;
                Ok(display)
            }
            Err(error) => {
                execute!(io::stderr(), Show, LeaveAlternateScreen)?;
                Err(error)
            }
        }
    }

    pub(super) fn message(&mut self, text: String) {
        self.message = text;
    }

    pub(super) fn draw(&mut self, status: &LiveStatus, map: Option<&Value>) {
        let (stage, message) = (&self.stage, &self.message);
        // A terminal that went away is noticed by its signal.
        let _ = self.terminal.draw(|frame| draw(frame, stage, status, map, message));
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        let _ = execute!(io::stderr(), Show, LeaveAlternateScreen);
        let _ = io::stderr().flush();
        if !self.message.is_empty() {
            depthloom_terminal::say(&self.message);
        }
    }
}

fn draw(frame: &mut Frame<'_>, stage: &str, status: &LiveStatus, map: Option<&Value>, message: &str) {
    let rows = status.steps.iter().filter(|step| !matches!(step.phase, Phase::Encode(_))).count() + 1;
    let rows = u16::try_from(rows).unwrap_or(u16::MAX).saturating_add(2);
    let [head, bars, picture, foot] =
        Layout::vertical([Constraint::Length(2), Constraint::Max(rows), Constraint::Fill(1), Constraint::Length(1)])
            .areas(frame.area());
    frame.render_widget(Paragraph::new(head_lines(stage, status)), head);
    frame.render_widget(
        Paragraph::new(bar_lines(status, bars.width))
            .block(Block::bordered().title("latency since capture, ms: p50, p99")),
        bars,
    );
    if let Some(lines) = map.and_then(|map| picture_lines(map, picture)) {
        frame.render_widget(Paragraph::new(lines), picture);
    }
    let foot_line = if message.is_empty() { "Ctrl-C ends the stream" } else { message };
    frame.render_widget(Paragraph::new(foot_line.to_owned()).style(Style::new().fg(Color::DarkGray)), foot);
}

fn head_lines<'a>(stage: &str, status: &LiveStatus) -> Vec<Line<'a>> {
    let seconds = status.elapsed.as_secs();
    let drops: Vec<String> = status.drops.by_cause().iter().map(|(cause, count)| format!("{cause} {count}")).collect();
    let is_dropping = status.drops.total() > 0;
    let dropped = format!("dropped {} ({})", status.drops.total(), drops.join(", "));
    vec![
        Line::from(format!(
            "{stage}  {:02}:{:02}:{:02}   {:.1} of {:.1} frames per second   window {}",
            seconds / 3600,
            seconds / 60 % 60,
            seconds % 60,
            status.processed_hz,
            status.offered_hz,
            status.window
        )),
        Line::from(vec![
            Span::raw(format!("processed {}   ", status.processed)),
            Span::styled(dropped, if is_dropping { Style::new().fg(Color::Yellow) } else { Style::new() }),
        ]),
    ]
}

/// One bar per node, from its p50 to its p99 in another colour.
fn bar_lines<'a>(status: &LiveStatus, width: u16) -> Vec<Line<'a>> {
    let steps: Vec<&StepLatency> = status.steps.iter().filter(|step| !matches!(step.phase, Phase::Encode(_))).collect();
    let names = steps.iter().map(|step| step.label.chars().count()).max().unwrap_or(0).max("estimates".len());
    let all = steps.iter().map(|step| (step.label.as_str(), step.latency.p50_ns, step.latency.p99_ns));
    let all: Vec<(&str, u64, u64)> =
        std::iter::once(("estimates", status.frames.p50_ns, status.frames.p99_ns)).chain(all).collect();
    let longest = all.iter().map(|(_, _, p99)| *p99).max().unwrap_or(0).max(1);
    // Borders, the name, two numbers and the spaces between.
    let room = usize::from(width).saturating_sub(names + 20);
    let length = |ns: u64| (room as u128 * u128::from(ns) / u128::from(longest)) as usize;
    let line = |(name, p50, p99): (&str, u64, u64)| {
        let (to_p50, to_p99) = (length(p50), length(p99));
        Line::from(vec![
            Span::raw(format!("{name:names$} {:7.1} {:7.1} ", p50 as f64 / 1e6, p99 as f64 / 1e6)),
            Span::styled("█".repeat(to_p50), Style::new().fg(Color::Green)),
            Span::styled("░".repeat(to_p99.saturating_sub(to_p50)), Style::new().fg(Color::Yellow)),
        ])
    };
    all.into_iter().map(line).collect()
}

/// The map, with two pixels per character: the upper half block has the colours of both.
fn picture_lines<'a>(map: &Value, area: Rect) -> Option<Vec<Line<'a>>> {
    let picture = Picture::new(map, u32::from(area.width), 2 * u32::from(area.height))?;
    let colour = |x: u32, y: u32| {
        let [r, g, b] = picture.colour(x, y);
        Color::Rgb(r, g, b)
    };
    let line = |row: u32| {
        let cells = (0..picture.width).map(|x| {
            let below = if 2 * row + 1 < picture.height { colour(x, 2 * row + 1) } else { Color::Reset };
            Span::styled("▀", Style::new().fg(colour(x, 2 * row)).bg(below))
        });
        Line::from(cells.collect::<Vec<_>>())
    };
    Some((0..picture.height.div_ceil(2)).map(line).collect())
}

/// Draws on any backend, for tests.
#[cfg(test)]
fn drawn<B: ratatui::backend::Backend>(backend: B, status: &LiveStatus, map: Option<&Value>) -> Terminal<B>
where
    B::Error: std::fmt::Debug,
{
    let mut terminal = Terminal::new(backend).unwrap();
    terminal.draw(|frame| draw(frame, "fly", status, map, "")).unwrap();
    terminal
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::Value;
    use depthloom_graphs::plan::NodeId;
    use depthloom_graphs::values::{Depth, Raster};
    use depthloom_runner::{Latency, LiveStatus, Phase, StepLatency};
    use ratatui::backend::TestBackend;
    use ratatui::style::Color;

    use super::super::tests::status;
    use super::drawn;

    #[test]
    fn the_display_has_rate_drops_a_bar_per_node_and_the_map() {
        let step = |label: &str, ms: u64| StepLatency {
            label: label.to_owned(),
            phase: Phase::Node(NodeId(0)),
            latency: Latency { count: 3, p50_ns: ms * 1_000_000, p99_ns: 2 * ms * 1_000_000, ..Latency::default() },
            median_wall_ns: 0,
        };
        let status = LiveStatus { steps: vec![step("stereo", 10), step("fused", 30)], ..status() };
        let metres = Raster::from_raw(8, 4, (0..32).map(|k| 1.0 + k as f32).collect()).unwrap();
        let map = Value::from(Depth { metres });
        let terminal = drawn(TestBackend::new(60, 14), &status, Some(&map));
        let buffer = terminal.backend().buffer();
        let text: Vec<String> = (0..14)
            .map(|y| (0..60).map(|x| buffer[(x, y)].symbol().to_owned()).collect::<String>().trim_end().to_owned())
            .collect();
        assert_eq!(text[0], "fly  00:00:05   28.0 of 30.0 frames per second   window 2");
        assert_eq!(text[1], "processed 140   dropped 10 (graph 7, recording 2, source 1)");
        assert!(text[3].contains("estimates    31.0    44.4 █"), "{text:#?}");
        assert!(text[4].contains("stereo       10.0    20.0 █") && text[5].contains("fused        30.0    60.0 █"));
        assert!(text[7].starts_with('▀'), "{text:#?}");
        assert_ne!(buffer[(0, 7)].fg, buffer[(11, 7)].fg, "near and far differ");
        assert!(matches!(buffer[(0, 7)].fg, Color::Rgb(..)));
        assert_eq!(text[13], "Ctrl-C ends the stream");
    }
}
