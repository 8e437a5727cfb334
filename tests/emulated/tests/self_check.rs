//! The self-check on board, against the same frames on the host and against the truth.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use emulated::converter::Plain;
use emulated::{Conversation, Error, Heard};
use shared::identify::static_test::{Bench, workspace_len};
use shared::model::{Coefficients, FURTHER, NOMINAL, SpecificForce};
use shared::self_check::{Limits, MARKS, MOUNTS, Outcome, ReadingSums, SelfCheck, SetUp, Verdict};
use shared::tumble::{Position, full_rank_plan, paper_plan};
use shared::wire::message::{self, Approach, Block, Segment};
use shared::wire::{Command, version};

const V_PER_CODE: f64 = 1.2 / 8_388_608.0;
const ARCSEC_RAD: f64 = 4.848e-6;

const SET_UP: SetUp = SetUp {
    bench: Bench {
        dial_sigma_rad: ARCSEC_RAD,
        dial_repeat_sigma_rad: 0.2 * ARCSEC_RAD,
        mount_sigma_rad: 60.0 * ARCSEC_RAD,
        level_sigma_rad: ARCSEC_RAD,
        local_gravity_g: 1.0,
    },
    nominal_v_per_g: 0.8,
    reference_v_per_g: Some([0.8; 3]),
};

fn truth() -> Coefficients<f64> {
    Coefficients::from_nominal([
        0.81, 2e-4, -6.2e-4, 3.9e-4, 2.7e-4, -4.9e-5, 3.8e-4, -6e-4, -4.6e-5, 2.6e-5, 5e-5,
    ])
}

/// The specific force on the emulated instrument, as the dial turns.
type Dial = Arc<Mutex<SpecificForce<f64>>>;

fn set(dial: &Dial, a: SpecificForce<f64>) {
    *dial.lock().unwrap_or_else(PoisonError::into_inner) = a;
}

/// An instrument on an exact dial, with noise of some nine codes rms.
fn instrument(c: Coefficients<f64>, dial: Dial) -> Plain {
    let mut state = 1u64;
    Plain::new(8_192_000, move |_| {
        let a = *dial.lock().unwrap_or_else(PoisonError::into_inner);
        let volts = [c.output_v(a), 0.8 * a.i, 0.8 * a.p, 0.8 * a.o];
        volts.map(|v| {
            // Steele, Lea and Flood's splitmix64; the upper bits.
            state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
            let mixed = (state ^ state >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
            let noise = (mixed >> 59) as f64 - 15.5;
            (v / V_PER_CODE + noise).round() as i32
        })
    })
}

struct Run {
    board: Outcome,
    host: Outcome,
}

/// A static test over the link; the blocks are also absorbed here.
fn static_test(
    c: Coefficients<f64>,
    plan: impl Iterator<Item = Position>,
    stored: Option<message::Coefficients>,
) -> Result<Run, Error> {
    let dial = Dial::default();
    let mut host = Conversation::start(instrument(c, dial.clone()))?;
    if let Some(stored) = stored {
        assert!(host.command(&Command::SetCoefficients(stored))?.is_some());
    }
    assert!(host.command(&Command::BeginCheck(SET_UP))?.is_some());
    let mut workspace = vec![0.0; workspace_len(MARKS, MOUNTS)];
    let mut check = SelfCheck::new(SET_UP, &mut workspace).expect("room");
    for (position, reading) in plan.zip(0..) {
        set(&dial, position.specific_force());
        // Nothing that was converted before the dial stood still.
        host.listen(Duration::from_millis(2))?;
        host.heard();
        host.command(&Command::StartPosition(message::Position {
            reading,
            series: position.series.into(),
            dial_deg: position.dial_deg,
            mount_deg: position.mount_deg,
            approach: Approach::Cw,
        }))?;
        host.listen(Duration::from_millis(400))?;
        host.command(&Command::StopPosition)?;
        let mut sums = ReadingSums::default();
        let of_reading = |block: &Block| block.segment == Segment::Reading(reading);
        for heard in host.heard() {
            if let Heard::Block(block) = heard
                && of_reading(&block)
            {
                sums.absorb(&block);
            }
        }
        check
            .absorb(position, &sums, [V_PER_CODE; 4])
            .expect("a sound reading");
    }
    assert!(host.command(&Command::Conclude)?.is_some());
    host.listen(Duration::from_millis(20))?;
    let board = host.heard().into_iter().find_map(|heard| match heard {
        Heard::Check(outcome) => Some(outcome),
        _ => None,
    });
    let stored = stored.map(|c| Coefficients::from_nominal(c.nominal).with_further(c.further));
    Ok(Run {
        board: board.expect("an outcome"),
        host: check
            .conclude(&Limits::default(), stored.as_ref(), 0)
            .expect("determined"),
    })
}

fn assert_agree(run: &Run) {
    for k in 0..NOMINAL {
        let (board, host) = (run.board.coefficients[k], run.host.coefficients[k]);
        // Relative to the scale of what is identified: a coefficient that is zero has no digits of its own.
        assert!(
            (board - host).abs() <= 1e-12 * host.abs().max(1e-3),
            "{k}: {board:e} {host:e}"
        );
    }
    assert_eq!(run.board.verdicts, run.host.verdicts);
    assert_eq!(run.board.readings, run.host.readings);
}

#[test]
fn board_and_host_identify_the_same_coefficients_and_these_are_the_instruments() -> Result<(), Error>
{
    let c = truth();
    let run = static_test(c, full_rank_plan(), None)?;
    assert_agree(&run);
    assert!(run.board.verdicts.passed(), "{:?}", run.board);
    assert_eq!(usize::from(run.board.rank), NOMINAL);
    for (k, truth) in c.to_nominal().into_iter().enumerate() {
        let off = (run.board.coefficients[k] - truth).abs();
        assert!(off < 4.0 * run.board.sigma[k], "{k}: {off:e}");
    }
    Ok(())
}

#[test]
fn what_is_wrong_is_named() -> Result<(), Error> {
    let mut stored = message::Coefficients {
        nominal: truth().to_nominal(),
        further: [0.0; FURTHER],
    };
    stored.nominal[1] += 1e-3;
    let mut c = truth();
    c.bias_g = 0.02;
    let run = static_test(c, paper_plan(), Some(stored))?;
    assert_agree(&run);
    let named: Vec<_> = run.board.verdicts.iter().collect();
    assert_eq!(named, [Verdict::Bias, Verdict::Blind, Verdict::Changed]);
    // Beside further coefficients a static test finds others.
    stored.further[2] = 3e-4;
    let run = static_test(c, paper_plan(), Some(stored))?;
    assert_agree(&run);
    let named: Vec<_> = run.board.verdicts.iter().collect();
    assert_eq!(named, [Verdict::Bias, Verdict::Blind]);
    Ok(())
}

#[test]
fn a_check_that_was_not_begun_is_refused() -> Result<(), Error> {
    let mut host = Conversation::start(instrument(truth(), Dial::default()))?;
    let version = version::CURRENT;
    assert!(host.command(&Command::Hello { version })?.is_some());
    let number = host.send(&Command::Conclude);
    host.listen(Duration::from_millis(50))?;
    let refused = |heard: &Heard| matches!(heard, Heard::Refused(n, message::Refusal::NoCheck) if *n == number);
    assert!(host.heard().iter().any(refused));
    Ok(())
}
