//! The unmodified image measures, and loses nothing.

use std::time::Duration;

use emulated::board::INSTRUCTIONS_PER_SECOND;
use emulated::converter::Plain;
use emulated::image::Rate;
use emulated::{Conversation, Emulator, Error, Heard};
use shared::wire::Command;
use shared::wire::message::{Approach, Position, Segment};

/// Codes that tell their conversion.
fn counting(conversion: u64) -> [i32; 4] {
    let low = (conversion & 0x3F_FFFF) as i32;
    [low, -low, low >> 4, 5]
}

const CLOCK_HZ: u32 = 8_192_000;

fn position(reading: u32) -> Position {
    Position {
        reading,
        series: 1,
        dial_deg: 45.0,
        mount_deg: 0.0,
        approach: Approach::Cw,
    }
}

#[test]
fn a_reading_comes_back_as_blocks_of_every_conversion_since_the_command() -> Result<(), Error> {
    let mut host = Conversation::start(Plain::new(CLOCK_HZ, counting))?;
    let greets = |heard: &Heard| matches!(heard, Heard::Hello(who) if who.sample_rate_hz == 4000.0);
    assert!(host.heard().iter().any(greets));

    let first = host.command(&Command::StartPosition(position(7)))?;
    host.listen(Duration::from_secs(1))?;
    let end = host.command(&Command::StopPosition)?;
    let (Some(first), Some(end)) = (first, end) else {
        panic!("a command was refused: {:?}", host.heard());
    };
    host.listen(Duration::from_millis(10))?;

    let mut next = first;
    for heard in host.heard() {
        if let Heard::Block(block) = heard
            && block.segment == Segment::Reading(7)
        {
            assert_eq!((block.first_sample, block.lost), (next, 0));
            next += u64::from(block.count);
        }
    }
    assert_eq!(next, end);
    assert!((4000..4100).contains(&(end - first)), "{}", end - first);
    Ok(())
}

/// Conversions by which commands may differ in their delay: a fetch of sixteen ends before the link looks for what has come,
/// another one before it is carried out, and it comes anywhere in a conversion.
const TWO_FETCHES: i64 = 33;

#[test]
fn a_command_waits_for_two_fetches_at_the_most_whatever_the_line_carries() -> Result<(), Error> {
    let mut host = Conversation::start(Plain::new(CLOCK_HZ, counting))?;
    for raw in [false, true] {
        host.command(&Command::StreamRaw { on: raw })?;
        let mut delays = Vec::new();
        for n in 0..50 {
            // Every phase of conversions and blocks.
            host.listen(Duration::from_micros(3000 + 137 * n))?;
            let sent = host.board.converter().conversions();
            let holds = host.command(&Command::StartPosition(position(n as u32)))?;
            // Those of the set-up have no index.
            delays.push(holds.expect("an answer") as i64 - sent as i64);
            host.command(&Command::StopPosition)?;
        }
        let (least, most) = (delays.iter().min(), delays.iter().max());
        let spread = most.zip(least).map(|(most, least)| most - least);
        println!("raw {raw}: {spread:?}");
        assert!(spread.is_some_and(|s| s <= TWO_FETCHES), "{delays:?}");
    }
    Ok(())
}

/// Conversions that may be made between what one answer tells and its being heard, beyond those of another one: it waits for a
/// batch of sixteen, for a frame that is on the line (a raw one takes 4 ms, those of a block 2 ms), and is looked for every
/// millisecond. Measured over 150 answers at all phases: 14 at 4 kSPS, 27 with raw samples, 41 at 16 kSPS.
fn answers_differ(rate: Rate, raw: bool) -> u64 {
    let waits_ms = if raw { 4 + 1 } else { 2 + 1 };
    16 + waits_ms * rate.hz() / 1000
}

/// Runs with or without raw samples, and counts.
fn loses_nothing(rate: Rate, seconds: u64, raw: bool) -> Result<(), Error> {
    let converter = Plain::new(CLOCK_HZ, counting);
    let board = Emulator::start_with_speed(converter, rate, INSTRUCTIONS_PER_SECOND)?;
    let mut host = Conversation::with_board(board)?;
    let rate_hz = rate.hz();
    host.command(&Command::StreamRaw { on: raw })?;
    let before = host.state()?.expect("an answer");
    let converted_before = host.board.converter().conversions();
    host.heard();
    let (mut in_blocks, mut in_raw) = (0, 0);
    let (mut next_block, mut next_raw) = (None, None);
    for _ in 0..seconds {
        host.listen(Duration::from_secs(1))?;
        for heard in host.heard() {
            match heard {
                Heard::Block(block) => {
                    assert_eq!(block.lost, 0);
                    assert_eq!(
                        *next_block.get_or_insert(block.first_sample),
                        block.first_sample
                    );
                    next_block = Some(block.first_sample + u64::from(block.count));
                    in_blocks += u64::from(block.count);
                }
                Heard::Raw(first, samples) => {
                    assert!(samples.len() >= 32);
                    // The codes tell the order in which they were converted.
                    assert!(samples.is_sorted_by_key(|sample| sample[0]));
                    assert_eq!(*next_raw.get_or_insert(first), first);
                    next_raw = Some(first + samples.len() as u64);
                    in_raw += samples.len() as u64;
                }
                Heard::Conditions(_) => {}
                other => panic!("unexpected: {other:?}"),
            }
        }
    }
    let after = host.state()?.expect("an answer");
    let converted = host.board.converter().conversions() - converted_before;
    let counted = after.conversions - before.conversions;
    assert!(
        counted.abs_diff(converted) <= answers_differ(rate, raw),
        "{counted} of {converted}"
    );
    assert_eq!(after.samples - before.samples, counted);
    assert_eq!(
        (after.lost, after.dropped_frames, after.last_fault),
        (0, 0, None)
    );
    // What is still gathered has not come yet: an open block or raw frame.
    let expected = seconds * rate_hz;
    assert!(in_blocks.abs_diff(expected) <= 500, "{in_blocks}");
    if raw {
        assert!(in_raw.abs_diff(expected) <= 100, "{in_raw}");
    }
    Ok(())
}

#[test]
fn no_conversion_of_a_minute_at_4_ksps_is_lost_in_blocks() -> Result<(), Error> {
    loses_nothing(Rate::X1024, 60, false)
}

#[test]
fn no_conversion_of_a_minute_at_4_ksps_is_lost_with_raw_samples_at_1_mbaud() -> Result<(), Error> {
    loses_nothing(Rate::X1024, 60, true)
}

#[test]
fn no_conversion_at_16_ksps_is_lost_in_blocks() -> Result<(), Error> {
    loses_nothing(Rate::X256, 15, false)
}
