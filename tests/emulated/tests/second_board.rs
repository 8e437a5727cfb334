//! The unmodified image of the NUCLEO-H743ZI2: it measures, and its memory survives a power cut at every write, on a flash
//! that programs and erases.

use std::time::Duration;

use emulated::board::INSTRUCTIONS_PER_SECOND;
use emulated::converter::Plain;
use emulated::image::Rate;
use emulated::random::Random;
use emulated::{Conversation, Emulator, Error, Heard, Model};
use shared::compensate::{Mode, Source};
use shared::model::FURTHER;
use shared::rectification::Covariance;
use shared::wire::Command;
use shared::wire::board::{Cause, TimeBase};
use shared::wire::configuration::{Calibration, Certified, Compensation, Configuration};
use shared::wire::message::{Coefficients, StoreFault};

const CLOCK_HZ: u32 = 8_192_000;

/// Bytes of the memory's first two slots.
const MEMORY: u64 = 2 * firmware::store::SLOT as u64;

/// Codes that tell their conversion.
fn counting(conversion: u64) -> [i32; 4] {
    let low = (conversion & 0x3F_FFFF) as i32;
    [low, -low, low >> 4, 5]
}

fn power(memory: Option<Vec<u8>>) -> Result<Conversation, Error> {
    let converter = Plain::new(CLOCK_HZ, counting);
    Conversation::with_board(Emulator::start_model(Model::H743, converter, memory)?)
}

/// Everything that a run of so many seconds brings is in order and whole.
fn loses_nothing(rate: Rate, seconds: u64, raw: bool) -> Result<(), Error> {
    let converter = Plain::new(CLOCK_HZ, counting);
    let board = Emulator::start_model_at(Model::H743, converter, rate, INSTRUCTIONS_PER_SECOND)?;
    let mut host = Conversation::with_board(board)?;
    host.command(&Command::StreamRaw { on: raw })?;
    host.heard();
    let converted = host.board.converter().conversions();
    let (mut in_blocks, mut in_raw) = (0, 0);
    let (mut next_block, mut next_raw) = (None, None);
    host.listen(Duration::from_secs(seconds))?;
    for heard in host.heard() {
        match heard {
            Heard::Block(block) => {
                assert_eq!(block.lost, 0);
                let next = *next_block.get_or_insert(block.first_sample);
                assert_eq!(next, block.first_sample);
                next_block = Some(next + u64::from(block.count));
                in_blocks += u64::from(block.count);
            }
            Heard::Raw(first, samples) => {
                assert!(samples.is_sorted_by_key(|sample| sample[0]));
                let next = *next_raw.get_or_insert(first);
                assert_eq!(next, first);
                next_raw = Some(next + samples.len() as u64);
                in_raw += samples.len() as u64;
            }
            Heard::Conditions(_) => {}
            other => panic!("unexpected: {other:?}"),
        }
    }
    let converted = host.board.converter().conversions() - converted;
    assert!(converted.abs_diff(in_blocks) <= 100, "{in_blocks}");
    assert!(!raw || converted.abs_diff(in_raw) <= 100, "{in_raw}");
    let state = host.state()?.expect("an answer");
    let told = (state.lost, state.dropped_frames, state.last_fault);
    assert_eq!(told, (0, 0, None));
    Ok(())
}

#[test]
fn no_conversion_of_ten_seconds_at_4_ksps_is_lost_with_raw_samples() -> Result<(), Error> {
    loses_nothing(Rate::X1024, 10, true)
}

#[test]
fn no_conversion_at_16_ksps_is_lost_in_blocks() -> Result<(), Error> {
    loses_nothing(Rate::X256, 5, false)
}

#[test]
fn the_board_says_why_it_started_and_what_its_clock_is_worth() -> Result<(), Error> {
    let mut host = power(None)?;
    let board = host.board_state()?.expect("an answer");
    assert_eq!(board.cause, Cause::Power);
    assert_eq!(board.boots, 1);
    assert_eq!(board.time_base, TimeBase::External);
    assert!(!board.brown_out_guarded && !board.write_protected);
    assert!(
        board.stack_free.is_some_and(|free| free > 4096),
        "{board:?}"
    );
    let warm = board.board_c.is_some_and(|c| (-40.0..125.0).contains(&c));
    assert!(warm, "{board:?}");
    Ok(())
}

#[test]
fn without_the_debuggers_clock_it_measures_and_says_so() -> Result<(), Error> {
    let converter = Plain::new(CLOCK_HZ, counting);
    let mut board = Emulator::start_model(Model::H743, converter, None)?;
    board.intervene(|session, _, _| session.board_mut().external_clock = false)?;
    board.run_for(Duration::from_millis(800))?;
    let mut host = Conversation::with_board(board)?;
    let board = host.board_state()?.expect("an answer");
    assert_eq!(board.time_base, TimeBase::Internal);
    host.heard();
    host.listen(Duration::from_millis(100))?;
    let is_block = |heard: &Heard| matches!(heard, Heard::Block(block) if block.lost == 0);
    assert!(host.heard().iter().any(is_block));
    Ok(())
}

/// With coefficients, in blocks of so many.
fn certified(block_samples: u16) -> Certified {
    let mut nominal = [0.0; 11];
    nominal[0] = 0.1;
    Configuration {
        compensation: Compensation {
            mode: Some(Mode::Block),
            source: Source::Reference,
            block_samples,
            nominal_v_per_g: 0.1,
            reference_v_per_g: [0.1; 3],
            reference_zero_v: [0.0; 3],
        },
        calibration: Some(Calibration {
            coefficients: Coefficients {
                nominal,
                further: [0.0; FURTHER],
            },
            covariance: Covariance::from_fn(|j, k| if j == k { 1e-12 } else { 0.0 }),
            rank: 11,
        }),
    }
    .into()
}

/// What a board that is powered with this memory keeps.
fn comes_up(memory: Vec<u8>) -> Result<(Option<Certified>, Option<StoreFault>), Error> {
    let mut host = power(Some(memory))?;
    host.heard();
    host.command(&Command::AskConfiguration)?;
    host.listen(Duration::from_millis(20))?;
    let heard = host.heard();
    let kept = heard.iter().find_map(|heard| match heard {
        Heard::Certified(kept) => Some(*kept),
        _ => None,
    });
    let fault = heard.iter().find_map(|heard| match heard {
        Heard::Stored(_, _, fault) => Some(*fault),
        _ => None,
    });
    let (Some(kept), Some(fault)) = (kept, fault) else {
        panic!("no answer: {heard:?}");
    };
    Ok((kept, fault))
}

/// Tells the board to keep this; what has become of that is heard later.
fn replace(host: &mut Conversation, certified: Option<Certified>) -> Result<(), Error> {
    host.command(&Command::AskConfiguration)?;
    host.listen(Duration::from_millis(20))?;
    let writes = host.heard().iter().rev().find_map(|heard| match heard {
        Heard::Stored(_, writes, _) => Some(*writes),
        _ => None,
    });
    let writes = writes.expect("an answer");
    host.send(&Command::Replace { writes, certified });
    Ok(())
}

/// What has become of it, once it is heard.
fn stored(host: &mut Conversation) -> Option<Option<StoreFault>> {
    host.heard().into_iter().find_map(|heard| match heard {
        Heard::Stored(_, _, fault) => Some(fault),
        _ => None,
    })
}

/// A board that came up with this memory and was told to keep something else.
fn replacing(memory: &[u8], certified: Option<Certified>) -> Result<Conversation, Error> {
    let mut host = power(Some(memory.to_vec()))?;
    replace(&mut host, certified)?;
    Ok(host)
}

/// Milliseconds in which the memory changes until it is told that this is kept. The same happens each time.
fn writing(memory: &[u8], certified: Option<Certified>) -> Result<Vec<bool>, Error> {
    let mut host = replacing(memory, certified)?;
    let (mut writes, mut last) = (Vec::new(), memory.to_vec());
    for _ in 0..2000 {
        host.listen(Duration::from_millis(1))?;
        let now = host.board.memory(MEMORY)?;
        writes.push(now != last);
        last = now;
        if let Some(fault) = stored(&mut host) {
            assert_eq!(fault, None);
            return Ok(writes);
        }
    }
    panic!("not kept");
}

/// The memory after each write that keeping this takes, the state before it first. A word takes some 20 us; most of the time
/// the board reads.
fn states(memory: &[u8], certified: Option<Certified>) -> Result<Vec<Vec<u8>>, Error> {
    let writes = writing(memory, certified)?;
    let mut host = replacing(memory, certified)?;
    let mut states = vec![memory.to_vec()];
    for k in 0..writes.len() {
        let near = &writes[k.saturating_sub(1)..writes.len().min(k + 2)];
        let steps = if near.contains(&true) { 100 } else { 1 };
        for _ in 0..steps {
            host.listen(Duration::from_millis(1) / steps)?;
            let now = host.board.memory(MEMORY)?;
            if states.last() != Some(&now) {
                states.push(now);
            }
        }
    }
    Ok(states)
}

/// A word that was being written when power failed: some of its bits.
fn torn(before: &[u8], after: &[u8], random: &mut Random) -> Vec<u8> {
    let bytes = before.iter().zip(after);
    bytes
        .map(|(before, after)| {
            let mask = random.number() as u8;
            before & mask | after & !mask
        })
        .collect()
}

/// Takes two minutes: the board starts twice for each of the 17 writes.
#[test]
fn power_that_fails_at_any_write_of_the_flash_leaves_the_old_or_the_new() -> Result<(), Error> {
    let (old, new) = (Some(certified(80)), Some(certified(20)));
    let mut host = power(None)?;
    // The first writing erases the sector, which takes seconds.
    replace(&mut host, old)?;
    let mut kept = None;
    for _ in 0..100 {
        host.listen(Duration::from_millis(100))?;
        kept = kept.or(stored(&mut host));
    }
    assert_eq!(kept, Some(None));
    let first = host.board.memory(MEMORY)?;
    assert_eq!(comes_up(first.clone())?, (old, None));
    let second = states(&first, new)?;
    println!("{} writes", second.len() - 1);
    // Words of 32 bytes: the record's, and the mark of the one before it.
    assert!(second.len() > 10, "{}", second.len());
    for (before, after) in second.iter().zip(&second[1..]) {
        let words = before.chunks(32).zip(after.chunks(32));
        assert_eq!(words.filter(|(before, after)| before != after).count(), 1);
    }
    let mut random = Random::new(7);
    let mut seen = [0; 2];
    for (before, after) in second.iter().zip(&second[1..]) {
        for memory in [before.clone(), torn(before, after, &mut random)] {
            let (kept, fault) = comes_up(memory)?;
            assert_eq!(fault, None);
            assert!(kept == old || kept == new);
            seen[usize::from(kept == new)] += 1;
        }
    }
    assert!(seen[0] > 10 && seen[1] >= 1, "{seen:?}");
    assert_eq!(comes_up(second[second.len() - 1].clone())?, (new, None));
    Ok(())
}
