//! The unmodified image comes up with what its memory holds, and goes on measuring when the memory fails.
//!
//! The emulated flash can be read only: what a store of the firmware makes on a model of the flash is placed in it, and
//! what the image writes or erases is lost.

use std::time::Duration;

use embassy_futures::block_on;
use emulated::converter::Plain;
use emulated::{Conversation, Emulator, Error, Heard};
use firmware::store::Store;
use host::bench::flash::{Flash, Power};
use shared::compensate::{Mode, Quality, Source};
use shared::model::FURTHER;
use shared::rectification::Covariance;
use shared::wire::Command;
use shared::wire::configuration::{Calibration, Certified, Compensation, Configuration};
use shared::wire::message::{Coefficients, Refusal, StoreFault};

const COMPENSATION: Compensation = Compensation {
    mode: Some(Mode::Block),
    source: Source::Reference,
    block_samples: 80,
    nominal_v_per_g: 0.1,
    reference_v_per_g: [0.1; 3],
    reference_zero_v: [0.0; 3],
};

/// Without coefficients, in long blocks.
const OLD: Configuration = Configuration {
    compensation: COMPENSATION,
    calibration: None,
};

fn old() -> Certified {
    OLD.into()
}

/// So many writings, the last of which is the old one.
fn written(count: usize) -> Flash {
    let contents: Vec<_> = (0..count)
        .map(|n| Some(if (count - n) % 2 == 1 { old() } else { new() }))
        .collect();
    kept(&contents, None)
}

/// With coefficients, in short blocks.
fn new() -> Certified {
    let mut nominal = [0.0; 11];
    nominal[0] = 0.1;
    Configuration {
        compensation: Compensation {
            block_samples: 20,
            ..COMPENSATION
        },
        calibration: Some(Calibration {
            coefficients: Coefficients {
                nominal,
                further: [0.0; FURTHER],
            },
            covariance: Covariance::default(),
            rank: 11,
        }),
    }
    .into()
}

/// Keeps one after the other; power fails as many bytes into the last as `left` says.
fn kept(contents: &[Option<Certified>], left: Option<usize>) -> Flash {
    let mut flash = Flash::new(3);
    for (n, content) in contents.iter().enumerate() {
        if let (true, Some(left)) = (n + 1 == contents.len(), left) {
            flash.power = Power::Left(left);
        }
        let mut store = Store::new(flash);
        block_on(store.keep(content.as_ref()));
        flash = store.into_flash();
    }
    flash
}

/// A board that is powered with this in its memory, and a constant signal of some 0.01 g.
fn power(memory: &Flash) -> Result<Conversation, Error> {
    let converter = Plain::new(8_192_000, |n| {
        let code = 7000 + (n % 5) as i32;
        [code, code, 1 - code, 3]
    });
    Conversation::with_board(Emulator::start_with_memory(
        converter,
        memory.bytes.clone(),
    )?)
}

/// What the board says that it came up with, and that it compensates so.
fn comes_up(
    memory: &Flash,
    known: Option<Certified>,
    stored: (u32, Option<StoreFault>),
) -> Result<(), Error> {
    let mut host = power(memory)?;
    host.heard();
    host.command(&Command::AskConfiguration)?;
    host.listen(Duration::from_millis(200))?;
    let heard = host.heard();
    assert!(heard.contains(&Heard::Certified(known)), "{heard:?}");
    let told = heard.iter().find_map(|heard| match heard {
        Heard::Stored(_, writes, fault) => Some((*writes, *fault)),
        _ => None,
    });
    assert_eq!(told, Some(stored));

    let mut freed = heard.iter().filter_map(|heard| match heard {
        Heard::Compensated(block) => Some(*block),
        _ => None,
    });
    let Some(Certified {
        configuration: known,
        ..
    }) = known
    else {
        assert_eq!(freed.next(), None);
        return Ok(());
    };
    let missing = known.calibration.is_none();
    let mut count = 0;
    for block in freed {
        assert_eq!(
            block.count,
            u32::from(known.compensation.block_samples),
            "{block:?}"
        );
        let told = block.quality.0 & Quality::COEFFICIENTS_MISSING != 0;
        assert_eq!(told, missing, "{block:?}");
        count += 1;
    }
    assert!(count >= 8, "{count}");
    Ok(())
}

#[test]
fn a_board_comes_up_with_nothing_the_old_or_the_new_and_says_which() -> Result<(), Error> {
    let (old, new) = (Some(old()), Some(new()));
    comes_up(&Flash::new(1), None, (0, None))?;
    comes_up(&kept(&[old], None), old, (1, None))?;
    comes_up(&kept(&[old, new], None), new, (2, None))?;
    comes_up(&kept(&[old, new, None], None), None, (3, None))
}

#[test]
fn a_board_whose_power_failed_while_writing_comes_up_with_the_old_or_the_new() -> Result<(), Error>
{
    let (old, new) = (Some(old()), Some(new()));
    comes_up(&kept(&[old, new], Some(100)), old, (1, None))?;
    // The record is whole, the one before is not marked.
    comes_up(
        &kept(&[old, new], Some(firmware::store::SLOT - 4)),
        new,
        (2, None),
    )?;
    comes_up(&kept(&[old, new, None], Some(3)), new, (2, None))
}

#[test]
fn a_board_whose_memory_went_bad_says_so_and_does_not_compensate() -> Result<(), Error> {
    let mut spoilt = kept(&[Some(old()), Some(new())], None);
    spoilt.bytes[firmware::store::SLOT + 40] ^= 4;
    let corrupt = (0, Some(StoreFault::Corrupt));
    comes_up(&spoilt, None, corrupt)?;
    let mut garbage = Flash::new(1);
    for (n, byte) in garbage.bytes.iter_mut().enumerate() {
        *byte = (n * n / 7) as u8;
    }
    comes_up(&garbage, None, corrupt)
}

/// Configures a board whose memory takes nothing.
fn fails_and_goes_on(memory: &Flash, writes: u32, erases: bool) -> Result<(), Error> {
    let mut host = power(memory)?;
    let before = host.state()?.expect("an answer");
    host.heard();
    let configure = Command::Replace {
        writes,
        certified: Some(new()),
    };
    assert!(host.command(&configure)?.is_some());
    if erases {
        // The link answers meanwhile.
        assert_eq!(host.command(&configure)?, None);
    }
    host.listen(Duration::from_millis(800))?;
    let after = host.state()?.expect("an answer");
    let heard = host.heard();
    let busy = |heard: &Heard| matches!(heard, Heard::Refused(_, Refusal::Busy));
    assert_eq!(
        heard.iter().filter(|heard| busy(heard)).count(),
        usize::from(erases)
    );
    let told = heard.iter().find_map(|heard| match heard {
        Heard::Stored(_, writes, fault) => Some((*writes, *fault)),
        _ => None,
    });
    assert_eq!(told, Some((writes, Some(StoreFault::Verify))));

    // It holds nevertheless, until power fails.
    assert!(after.compensating);
    let mut next = None;
    for heard in heard {
        if let Heard::Block(block) = heard {
            assert_eq!(
                (block.first_sample, block.lost),
                (next.unwrap_or(block.first_sample), 0)
            );
            next = Some(block.first_sample + u64::from(block.count));
        }
    }
    assert_eq!((after.lost, after.dropped_frames), (before.lost, 0));
    assert_eq!(after.last_fault, None);
    assert_eq!(after.conversions - after.samples, after.lost);
    assert!(after.samples > before.samples + 3000);
    Ok(())
}

#[test]
fn a_memory_that_takes_nothing_is_told_and_not_one_sample_is_lost() -> Result<(), Error> {
    // The first writing and the seventeenth erase a sector before they write.
    fails_and_goes_on(&Flash::new(1), 0, true)?;
    fails_and_goes_on(&written(2), 2, false)?;
    fails_and_goes_on(&written(16), 16, true)
}
