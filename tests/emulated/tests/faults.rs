//! The unmodified image under faults: the acquisition goes on or names what stops it, and every conversion is a sample
//! or counted as lost.

use std::num::NonZeroU64;
use std::time::Duration;

use emulated::board::{INSTRUCTIONS_PER_SECOND, Shared, lock};
use emulated::converter::Plain;
use emulated::faults::{ConverterFaults, Drdy, Faulty};
use emulated::image::Rate;
use emulated::line::Noise;
use emulated::random::Random;
use emulated::{Conversation, Emulator, Error, Heard};
use shared::wire::Command;
use shared::wire::board::Cause;
use shared::wire::framing::Frame;
use shared::wire::message::{Approach, Block, Fault, Position, Segment, State};
use shared::wire::version;

const CLOCK_HZ: u32 = 8_192_000;
const BLOCK: u64 = 40;

/// Bytes of garbage in a second, a fifth of what the line can carry.
const GARBAGE: usize = 18_000;

const fn milliseconds(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

/// Codes that tell their conversion.
fn counting(conversion: u64) -> [i32; 4] {
    [(conversion & 0x3F_FFFF) as i32, 0, 0, 5]
}

fn position(reading: u32) -> Position {
    Position {
        reading,
        series: 1,
        dial_deg: 45.0,
        mount_deg: 0.0,
        approach: Approach::Cw,
    }
}

/// A board whose converter can be broken.
struct Bench {
    host: Conversation,
    faults: Shared<ConverterFaults>,
    heard: Vec<Heard>,
    rate_hz: u64,
}

/// The counters of the instrument, and at about the same time what the converter's model knows.
#[derive(Clone, Copy, Debug)]
struct Count {
    state: State,
    /// Conversions that were made.
    made: u64,
    /// Periods of the converter since power came on.
    periods: u64,
}

impl Bench {
    fn start(seed: u64) -> Result<Self, Error> {
        Self::start_with_speed(Rate::X1024, seed, INSTRUCTIONS_PER_SECOND.get())
    }

    fn start_with_speed(
        rate: Rate,
        seed: u64,
        instructions_per_second: u64,
    ) -> Result<Self, Error> {
        let speed = NonZeroU64::new(instructions_per_second).expect("not zero");
        let faults = Shared::<ConverterFaults>::default();
        let converter = Faulty::new(Plain::new(CLOCK_HZ, counting), faults.clone(), seed);
        Ok(Self {
            host: Conversation::with_board(Emulator::start_with_speed(converter, rate, speed)?)?,
            faults,
            heard: Vec::new(),
            rate_hz: rate.hz(),
        })
    }

    fn listen(&mut self, time: Duration) -> Result<(), Error> {
        self.host.listen(time)?;
        self.heard.extend(self.host.heard());
        Ok(())
    }

    fn command(&mut self, command: &Command) -> Result<Option<u64>, Error> {
        let answer = self.host.command(command)?;
        self.heard.extend(self.host.heard());
        Ok(answer)
    }

    fn break_converter(&self, faults: ConverterFaults) {
        *lock(&self.faults) = faults;
    }

    fn set_noise(&self, way_there: Noise, way_back: Noise) {
        let mut line = self.host.board.line();
        (line.way_there, line.way_back) = (way_there, way_back);
    }

    /// Counts; the answer is looked for every millisecond.
    fn count(&mut self) -> Result<Count, Error> {
        self.host.state()?;
        self.heard.extend(self.host.heard());
        let state = self.heard.iter().rev().find_map(|heard| match heard {
            Heard::State(state) => Some(*state),
            _ => None,
        });
        let made = self.host.board.converter().conversions();
        let now_us = self.host.board.now().as_micros() as u64;
        Ok(Count {
            state: state.expect("an answer"),
            made,
            periods: now_us * self.rate_hz / 1_000_000,
        })
    }

    /// Conversions in a millisecond and a bit, in which an answer is looked for.
    fn looked(&self) -> u64 {
        2 * self.rate_hz / 1000
    }

    fn blocks(&self) -> impl Iterator<Item = &Block> {
        self.heard.iter().filter_map(|heard| match heard {
            Heard::Block(block) => Some(block),
            _ => None,
        })
    }

    fn faults(&self) -> Vec<Fault> {
        let faults = self.heard.iter().filter_map(|heard| match heard {
            Heard::Fault(_, fault) => Some(*fault),
            _ => None,
        });
        faults.collect()
    }

    /// Code and index of every sample differ by the same number: no sample has the index of another.
    fn indices_tell_the_conversions(&self) {
        let whole = |block: &&Block| u64::from(block.count) == BLOCK && block.lost == 0;
        let mut blocks = self.blocks().filter(whole).map(|block| {
            let indices = BLOCK * block.first_sample + BLOCK * (BLOCK - 1) / 2;
            block.moments.sum[0] - indices as i64
        });
        let first = blocks.next();
        assert!(blocks.all(|off| Some(off) == first));
    }

    /// The blocks that were heard leave no hole: samples and losses in them.
    fn without_hole(&self) -> (u64, u64) {
        let mut next = None;
        let (mut samples, mut lost) = (0, 0);
        for block in self.blocks() {
            let first = block.first_sample;
            assert_eq!(*next.get_or_insert(first), first);
            next = Some(first + u64::from(block.count) + u64::from(block.lost));
            samples += u64::from(block.count);
            lost += u64::from(block.lost);
        }
        (samples, lost)
    }
}

/// What a fault and its end cost.
#[derive(Debug)]
struct Cost {
    /// Conversions.
    lost: u64,
    set_ups: u32,
}

/// Runs into a fault and out of it; every conversion is accounted for, and nothing is lost afterwards.
fn ride_out(bench: &mut Bench, faults: ConverterFaults, time: Duration) -> Result<Cost, Error> {
    bench.listen(milliseconds(20))?;
    let before = bench.count()?;
    bench.heard.clear();
    bench.break_converter(faults);
    bench.listen(time)?;
    bench.break_converter(ConverterFaults::default());
    // What was begun under the fault ends.
    bench.listen(milliseconds(30))?;
    let mended = bench.count()?;
    bench.listen(milliseconds(100))?;
    let after = bench.count()?;

    let conversions = after.state.conversions - before.state.conversions;
    let samples = after.state.samples - before.state.samples;
    let lost = after.state.lost - before.state.lost;
    let set_ups = after.state.converter_resets - before.state.converter_resets;
    assert_eq!(conversions, samples + lost);
    // A converter in reset makes no conversions, but the indices go on with its periods.
    let (made, periods) = (after.made - before.made, after.periods - before.periods);
    let counted = made.saturating_sub(bench.looked())..=periods + bench.looked();
    assert!(
        counted.contains(&conversions),
        "{conversions} not in {counted:?}, {lost} lost"
    );
    // Recovered.
    assert_eq!(after.state.lost, mended.state.lost, "{:?}", bench.faults());
    assert!(after.state.samples - mended.state.samples >= bench.rate_hz / 10);
    assert_eq!(after.state.dropped_frames, 0);
    if set_ups == 0 {
        bench.indices_tell_the_conversions();
    }
    let (in_blocks, lost_in_blocks) = bench.without_hole();
    assert_eq!(lost_in_blocks, lost);
    assert!(
        in_blocks.abs_diff(samples) <= 2 * BLOCK,
        "{in_blocks} {samples}"
    );
    Ok(Cost { lost, set_ups })
}

/// Five standard deviations of so many chances of so much each, and what begins or ends halfway.
fn assert_likely(found: u64, chances: f64, each: f64) {
    let (mean, variance) = (chances * each, chances * each * (1.0 - each).max(0.0));
    let spread = 5.0 * variance.sqrt() + 5.0;
    assert!(
        (found as f64 - mean).abs() <= spread,
        "{found} not {mean} +- {spread}"
    );
}

#[test]
fn wrong_checksums_are_named_and_cost_their_conversions() -> Result<(), Error> {
    let mut bench = Bench::start(1)?;
    for wrong in [0.001, 0.05, 0.2, 0.5] {
        let faults = ConverterFaults {
            wrong_bits: wrong,
            ..ConverterFaults::default()
        };
        let ms = if wrong < 0.01 { 1500 } else { 400 };
        let cost = ride_out(&mut bench, faults, milliseconds(ms))?;
        println!("wrong checksums {wrong}: {cost:?}");
        let named = |fault: &Fault| matches!(fault, Fault::Checksum { .. });
        assert!(bench.faults().iter().any(named));
        // After a failure two frames are read, and both must be sound.
        let each = wrong / (1.0 - wrong + wrong * wrong);
        if wrong < 0.5 {
            assert_likely(cost.lost, ms as f64 * 1e-3 * bench.rate_hz as f64, each);
        }
        // Sixteen in a row and a set-up, again and again.
        let in_a_row = wrong >= 0.5;
        assert_eq!(cost.set_ups > 0, in_a_row, "{cost:?}");
        let board = bench.host.board_state()?.expect("an answer");
        assert_eq!(board.checksum_set_ups > 0, in_a_row, "{board:?}");
    }
    Ok(())
}

#[test]
fn frames_that_are_all_wrong_lead_to_a_set_up_when_they_are_right_again() -> Result<(), Error> {
    let mut bench = Bench::start(1)?;
    for ms in [2, 40, 700] {
        let faults = ConverterFaults {
            wrong_bits: 1.0,
            ..ConverterFaults::default()
        };
        let cost = ride_out(&mut bench, faults, milliseconds(ms))?;
        println!(
            "all checksums wrong for {ms} ms: {cost:?} {:?}",
            bench.faults()
        );
        // In 2 ms there are 8 frames, which is not enough.
        assert_eq!(cost.set_ups, u32::from(ms > 4), "{cost:?}");
        assert!(cost.lost >= ms * bench.rate_hz / 1000 - 1);
        let board = bench.host.board_state()?.expect("an answer");
        assert_eq!(board.checksum_set_ups > 0, ms > 2, "{board:?}");
    }
    Ok(())
}

/// Data register of SPI4 (RM0090, 28.5.4).
const SPI4_DATA: u64 = 0x4001_340C;

#[test]
fn a_byte_left_in_the_bus_between_two_frames_costs_nothing() -> Result<(), Error> {
    let mut bench = Bench::start(1)?;
    bench.listen(milliseconds(20))?;
    let before = bench.count()?;
    // One that was sent without anybody to fetch what came in.
    // A conversion ends with each millisecond, and its frame is over 30 us later.
    bench.host.board.run_for(Duration::from_micros(30))?;
    bench.host.board.write_word(SPI4_DATA, 0)?;
    bench.listen(milliseconds(100))?;
    let after = bench.count()?;
    let wrong = after.state.converter_checksum_errors - before.state.converter_checksum_errors;
    let set_ups = after.state.converter_resets - before.state.converter_resets;
    let lost = after.state.lost - before.state.lost;
    assert_eq!((wrong, set_ups, lost), (0, 0, 0));
    Ok(())
}

#[test]
fn a_drdy_stuck_at_either_level_is_named_and_every_conversion_meanwhile_is_counted()
-> Result<(), Error> {
    let mut bench = Bench::start(1)?;
    for drdy in [Drdy::StuckLow, Drdy::StuckHigh] {
        // A pin that stands still while a batch is under way is told after two times twenty periods.
        for ms in [12, 40, 700] {
            let faults = ConverterFaults {
                drdy,
                ..ConverterFaults::default()
            };
            let cost = ride_out(&mut bench, faults, milliseconds(ms))?;
            println!("DRDY {drdy:?} for {ms} ms: {cost:?} {:?}", bench.faults());
            let named = |fault: &Fault| matches!(fault, Fault::DrdyTimeout { .. });
            assert!(bench.faults().iter().any(named), "{:?}", bench.faults());
            // Each kind of fault is told once.
            assert!(bench.faults().len() <= 4, "{:?}", bench.faults());
            assert!(cost.lost >= ms * bench.rate_hz / 1000);
            assert_eq!(cost.set_ups, 1);
        }
    }
    Ok(())
}

#[test]
fn an_irregular_drdy_leaves_no_conversion_uncounted() -> Result<(), Error> {
    let irregular = [
        (60_000, 0.0, 0.0),
        (0, 0.02, 0.0),
        (0, 0.0, 0.02),
        (60_000, 0.05, 0.05),
        (60_000, 0.3, 0.3),
    ];
    for seed in 1..=2 {
        let mut bench = Bench::start(seed)?;
        for (jitter_ns, missing, extra) in irregular {
            let drdy = Drdy::Irregular {
                jitter_ns,
                missing,
                extra,
            };
            let faults = ConverterFaults {
                drdy,
                ..ConverterFaults::default()
            };
            let cost = ride_out(&mut bench, faults, milliseconds(500))?;
            println!("DRDY {drdy:?}: {cost:?}");
            assert_eq!(cost.lost > 0, missing > 0.0, "{cost:?}");
        }
    }
    Ok(())
}

#[test]
fn a_converter_reset_at_any_moment_is_named_and_set_up_anew() -> Result<(), Error> {
    let mut bench = Bench::start(1)?;
    let mut random = Random::new(7);
    for _ in 0..12 {
        bench.listen(Duration::from_nanos(random.below(10_000_000)))?;
        let faults = ConverterFaults {
            reset: true,
            ..ConverterFaults::default()
        };
        let cost = ride_out(&mut bench, faults, milliseconds(1))?;
        println!("converter reset: {cost:?}");
        let named = |fault: &Fault| matches!(fault, Fault::Status { .. });
        assert!(bench.faults().iter().any(named), "{:?}", bench.faults());
        assert_eq!(cost.set_ups, 1);
        // One failed. The reset takes 1.3 periods, 57 frames of 14 us on the bus and as much again around each take 7, the
        // filter settles in 10, and beginning waits for the edge after that.
        assert!((1..=25).contains(&cost.lost), "{cost:?}");
    }
    Ok(())
}

/// Raw samples at more than the line or the processor can bear: nothing is missing without being counted.
fn overload(rate: Rate, instructions_per_second: u64) -> Result<Count, Error> {
    let mut bench = Bench::start_with_speed(rate, 1, instructions_per_second)?;
    let begun = bench.count()?;
    let on = Command::StreamRaw { on: true };
    assert!(bench.command(&on)?.is_some());
    let streaming = bench.count()?;
    bench.listen(milliseconds(700))?;
    let full = bench.count()?;
    let off = Command::StreamRaw { on: false };
    assert!(bench.command(&off)?.is_some());
    // Until the line has said what it had to.
    bench.listen(milliseconds(60))?;
    // Closes the block.
    assert!(
        bench
            .command(&Command::StartPosition(position(1)))?
            .is_some()
    );
    let after = bench.count()?;
    bench.listen(milliseconds(20))?;

    let State {
        conversions,
        samples,
        lost,
        dropped_frames,
        dropped_samples,
        ..
    } = after.state;
    println!(
        "{} conversions/s: {conversions} conversions, {lost} lost, {dropped_frames} frames with {dropped_samples} samples \
         dropped, {:?}",
        bench.rate_hz,
        bench.faults().first()
    );
    assert_eq!(conversions, samples + lost);
    let counted = conversions - begun.state.conversions;
    // Answers wait for a line that is full, so that the instrument's own clock tells when they were given; some
    // conversions are not accounted for yet.
    let passed_us = after.state.clock_us - begun.state.clock_us;
    let made = passed_us * bench.rate_hz / 1_000_000;
    assert!(counted.abs_diff(made) <= 20, "{counted} {made}");
    // The line is sound: what is missing was dropped, and counted.
    assert!(
        !bench
            .heard
            .iter()
            .any(|heard| matches!(heard, Heard::Missing(_) | Heard::Broken(_)))
    );
    let samples_of = |reading: bool| -> u64 {
        let blocks = bench.blocks();
        let those = blocks.filter(|block| (block.segment != Segment::Idle) == reading);
        those.map(|block| u64::from(block.count)).sum()
    };
    let raw = bench.heard.iter().map(|heard| match heard {
        Heard::Raw(_, samples) => samples.len() as u64,
        _ => 0,
    });
    let in_raw: u64 = raw.sum();
    let at_least = full.state.samples - streaming.state.samples;
    let at_most = samples - begun.state.samples;
    // Blocks of the reading go on after the last count: as many of their samples as there are may be in it, or none.
    let (in_idle, in_reading) = (samples_of(false), samples_of(true));
    let streamed = in_idle + in_raw + dropped_samples - samples;
    assert!(
        at_least <= streamed + in_reading && streamed <= at_most,
        "{at_least} {streamed} + {in_reading} {at_most}"
    );
    // No sample has the index of another.
    let raw_frames = bench.heard.iter().filter_map(|heard| match heard {
        Heard::Raw(first, samples) => Some(samples.first()?[0] as i64 - *first as i64),
        _ => None,
    });
    let mut off: Vec<_> = raw_frames.collect();
    off.dedup();
    assert!(off.len() <= 1, "{off:?}");
    // Samples of one raw frame follow each other as they were converted.
    for heard in &bench.heard {
        if let Heard::Raw(_, samples) = heard {
            assert!(samples.is_sorted_by(|a, b| a[0] + 1 == b[0]), "{samples:?}");
        }
    }
    Ok(after)
}

#[test]
fn an_overload_is_counted_to_the_sample() -> Result<(), Error> {
    let speed = INSTRUCTIONS_PER_SECOND.get();
    // At 16 kSPS the line is too slow for raw samples, the processor is not.
    let slow_line = overload(Rate::X256, speed)?;
    assert_eq!(slow_line.state.lost, 0);
    assert!(slow_line.state.dropped_samples > 0);
    // Measured: at 16 kSPS everything is lost below 26 % of the speed, nothing from 34 % on.
    let partial = overload(Rate::X256, speed * 31 / 100)?.state;
    assert!(partial.lost > 0 && partial.samples > partial.conversions / 50);
    let overrun = overload(Rate::X128, speed / 3)?;
    assert!(overrun.state.lost > 0, "no overload: {overrun:?}");
    Ok(())
}

#[test]
fn a_noisy_line_costs_frames_that_are_missed_by_their_number_and_nothing_else() -> Result<(), Error>
{
    let mut bench = Bench::start(1)?;
    for seed in 1..=3 {
        let before = bench.count()?;
        bench.heard.clear();
        let share = 1e-3;
        bench.set_noise(Noise::new(share, seed), Noise::new(share, seed + 100));
        // A host that says everything until it is heard.
        for reading in 0..6 {
            let open = Segment::Reading(reading);
            let begin = Command::StartPosition(position(reading));
            for (command, then) in [(begin, open), (Command::StopPosition, Segment::Idle)] {
                while bench.command(&command)?.is_none() {
                    // It may have been carried out, and the answer lost.
                    let state = bench.host.state()?;
                    bench.heard.extend(bench.host.heard());
                    if state.is_some_and(|state| state.segment == then) {
                        break;
                    }
                }
                bench.listen(milliseconds(80))?;
            }
        }
        bench.set_noise(Noise::default(), Noise::default());
        // A frame that had begun is lost with the one behind it.
        bench.listen(milliseconds(20))?;
        bench.count()?;
        let after = bench.count()?;
        let conversions = after.state.conversions - before.state.conversions;
        assert!(conversions.abs_diff(after.made - before.made) <= bench.looked());
        assert_eq!((after.state.lost, after.state.dropped_frames), (0, 0));
        assert_eq!(after.state.last_fault, None);

        let (mut next, mut missing, mut hole, mut holes) = (None, 0, false, 0);
        for heard in &bench.heard {
            match heard {
                Heard::Missing(count) => {
                    missing += u64::from(*count);
                    hole = true;
                }
                Heard::Block(block) => {
                    let first = block.first_sample;
                    let expected = *next.get_or_insert(first);
                    assert!(first == expected || hole && first > expected);
                    holes += first - expected;
                    next = Some(first + u64::from(block.count));
                    hole = false;
                }
                _ => {}
            }
        }
        println!(
            "noisy line, seed {seed}: {missing} frames missing with {holes} samples; {} frames to the board rejected",
            after.state.rejected_frames
        );
        assert!(missing > 0 && holes > 0);
        assert!(after.state.rejected_frames > before.state.rejected_frames);
    }
    Ok(())
}

#[test]
fn a_minute_of_garbage_on_the_line_is_rejected_and_nothing_is_lost() -> Result<(), Error> {
    let mut bench = Bench::start(1)?;
    let before = bench.count()?;
    bench.heard.clear();
    let mut random = Random::new(5);
    for _ in 0..60 {
        // In bursts as fast as the line goes.
        let garbage: Vec<u8> = (0..GARBAGE).map(|_| random.number() as u8).collect();
        bench.host.board.send(&garbage);
        bench.listen(milliseconds(1000))?;
    }
    // Ends the frame that the garbage began.
    bench.host.board.send(&[0]);
    let after = bench.count()?;
    println!(
        "a minute of garbage: {} frames rejected",
        after.state.rejected_frames
    );
    let conversions = after.state.conversions - before.state.conversions;
    assert!(conversions.abs_diff(after.made - before.made) <= bench.looked());
    assert_eq!((after.state.lost, after.state.last_fault), (0, None));
    assert!(after.state.rejected_frames > 1000);
    assert_eq!(after.state.dropped_frames, 0);
    let (samples, lost) = bench.without_hole();
    assert_eq!(lost, 0);
    assert!(samples.abs_diff(conversions) <= 2 * BLOCK);
    Ok(())
}

#[test]
fn each_command_of_a_flood_is_answered_or_its_answer_counted_as_dropped() -> Result<(), Error> {
    let mut bench = Bench::start(1)?;
    let before = bench.count()?;
    bench.heard.clear();
    let version = version::CURRENT;
    let flood = [
        Command::AskState,
        Command::Hello { version },
        Command::StartPosition(position(1)),
        Command::AskConfiguration,
        Command::StopRun,
        Command::StopPosition,
    ];
    let mut sent = 0;
    while bench.host.board.now() < milliseconds(1500) {
        let bytes_a_step = 92 * 5;
        let mut bytes = Vec::new();
        while bytes.len() < bytes_a_step {
            let mut frame = Frame::new();
            let encoded = frame.encode(&flood[sent % flood.len()], sent as u16);
            encoded.expect("a command fits");
            bytes.extend(frame.as_bytes());
            sent += 1;
        }
        bench.host.board.send(&bytes);
        bench.listen(milliseconds(5))?;
    }
    bench.listen(milliseconds(200))?;
    let after = bench.count()?;
    let answered = bench
        .heard
        .iter()
        .filter(|heard| matches!(heard, Heard::Ack(..) | Heard::Refused(..)));
    // The last one is that of the count.
    let answered = answered.count() as u64 - 1;
    let State {
        dropped_frames,
        rejected_frames,
        ..
    } = after.state;
    println!(
        "flood: {sent} commands, {answered} answered, {dropped_frames} frames dropped, {rejected_frames} rejected"
    );
    let conversions = after.state.conversions - before.state.conversions;
    assert!(conversions.abs_diff(after.made - before.made) <= bench.looked());
    assert_eq!((after.state.lost, after.state.last_fault), (0, None));
    assert!(answered > 1000);
    // Commands that the board had no time to hear are rejected as broken frames, each of which may be two.
    let accounted = answered + u64::from(dropped_frames) + 2 * u64::from(rejected_frames);
    assert!(accounted >= sent as u64, "{accounted} of {sent}");
    Ok(())
}

#[test]
fn a_board_reset_at_any_moment_begins_anew_and_measures() -> Result<(), Error> {
    let mut bench = Bench::start(1)?;
    let mut random = Random::new(11);
    for round in 0..12 {
        // In the middle of a reading, and of raw frames.
        assert!(bench.command(&Command::StreamRaw { on: true })?.is_some());
        assert!(
            bench
                .command(&Command::StartPosition(position(round)))?
                .is_some()
        );
        bench.listen(Duration::from_nanos(random.below(25_000_000)))?;
        bench.host.board.reset()?;
        // Also while it is still setting up.
        if round % 4 == 3 {
            bench.listen(Duration::from_nanos(random.below(3_000_000)))?;
            bench.host.board.reset()?;
        }
        bench.listen(milliseconds(25))?;
        // The frame that was cut takes the one behind it along.
        if !bench.host.greet()? {
            assert!(bench.host.greet()?);
        }
        bench.heard.clear();
        let before = bench.count()?;
        assert!(before.state.conversions < 500, "{:?}", before.state);
        assert_eq!(before.state.segment, Segment::Idle);
        bench.listen(milliseconds(30))?;
        let after = bench.count()?;
        assert_eq!((after.state.lost, after.state.last_fault), (0, None));
        let conversions = after.state.conversions - before.state.conversions;
        let made = after.made - before.made;
        assert!(
            conversions.abs_diff(made) <= bench.looked(),
            "{conversions} {made} {before:?} {after:?}"
        );
        assert_eq!(bench.without_hole().1, 0);
    }
    Ok(())
}

#[test]
fn a_byte_left_in_the_data_register_spoils_no_frame() -> Result<(), Error> {
    let mut bench = Bench::start(1)?;
    let before = bench.count()?;
    for _ in 0..20 {
        // Between two frames: 90 us after an edge, at whatever moment of the bus that is.
        bench.host.board.write_word(SPI4_DATA, 0xA5)?;
        bench.listen(milliseconds(7))?;
    }
    let after = bench.count()?;
    let errors = after.state.converter_checksum_errors - before.state.converter_checksum_errors;
    println!("bytes left: {errors} wrong frames");
    // A byte that is written while a frame is under way spoils that one.
    assert!(errors <= 4, "{errors}");
    assert!(after.state.samples - before.state.samples > 500);
    Ok(())
}

#[test]
fn a_bus_that_hangs_makes_the_watchdog_bite_and_the_board_measures_again() -> Result<(), Error> {
    const RCC_APB2ENR: u64 = 0x4002_3844;
    let mut bench = Bench::start(1)?;
    let before = bench.count()?;
    assert!(before.state.conversions > 0);
    // Without its clock the bus never ends a transfer.
    bench.host.board.write_word(RCC_APB2ENR, 0)?;
    bench.listen(milliseconds(1500))?;
    let hung = bench.host.board.converter().conversions();
    bench.heard.clear();
    bench.listen(milliseconds(1000))?;
    assert!(bench.host.greet()?);
    let after = bench.count()?;
    println!("watchdog: {hung} {after:?}");
    assert!(after.state.conversions < 4000, "{:?}", after.state);
    let board = bench.host.board_state()?.expect("an answer");
    assert_eq!((board.cause, board.boots), (Cause::Watchdog, 2));
    bench.heard.clear();
    bench.listen(milliseconds(50))?;
    let (samples, lost) = bench.without_hole();
    assert!(samples >= 3 * BLOCK && lost == 0);
    Ok(())
}
