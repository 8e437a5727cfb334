//! The unmodified image measures, and loses nothing.

use std::time::Duration;

use emulated::converter::Converter;
use emulated::{Conversation, Error, Heard};
use shared::wire::Command;
use shared::wire::message::{Approach, Position, Segment};

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
    let mut host = Conversation::start(Converter::default())?;
    assert!(
        matches!(host.heard().first(), Some(Heard::Hello(who)) if who.sample_rate_hz == 4000.0)
    );

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

/// Runs for a minute, with or without raw samples, and counts.
fn loses_nothing_in_a_minute(raw: bool) -> Result<(), Error> {
    let mut host = Conversation::start(Converter::default())?;
    host.command(&Command::StreamRaw { on: raw })?;
    let before = host.state()?.expect("an answer");
    let converted_before = host.board.converter().conversions;
    host.heard();
    let (mut in_blocks, mut in_raw) = (0, 0);
    let (mut next_block, mut next_raw) = (None, None);
    for _ in 0..60 {
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
                    assert_eq!(*next_raw.get_or_insert(first), first);
                    next_raw = Some(first + samples.len() as u64);
                    in_raw += samples.len() as u64;
                }
                other => panic!("unexpected: {other:?}"),
            }
        }
    }
    let after = host.state()?.expect("an answer");
    let converted = host.board.converter().conversions - converted_before;
    let counted = after.conversions - before.conversions;
    // The answers are looked for every millisecond, in which there are four conversions.
    assert!(counted.abs_diff(converted) <= 8, "{counted} of {converted}");
    assert_eq!(after.samples - before.samples, counted);
    assert_eq!(
        (after.lost, after.dropped_frames, after.last_fault),
        (0, 0, None)
    );
    // What is still gathered has not come yet.
    assert!((239_500..=240_100).contains(&in_blocks), "{in_blocks}");
    if raw {
        assert!((239_900..=240_100).contains(&in_raw), "{in_raw}");
    }
    Ok(())
}

#[test]
fn no_conversion_of_a_minute_at_4_ksps_is_lost_in_blocks() -> Result<(), Error> {
    loses_nothing_in_a_minute(false)
}

#[test]
fn no_conversion_of_a_minute_at_4_ksps_is_lost_with_raw_samples_at_921_600_baud()
-> Result<(), Error> {
    loses_nothing_in_a_minute(true)
}
