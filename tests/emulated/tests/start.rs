//! How the unmodified image starts and what it says of it: clocks, caches, supply, causes, time, temperature.

use std::time::Duration;

use emulated::converter::Plain;
use emulated::{Conversation, Emulator, Error, Heard};
use shared::compensate::{Mode, Quality, Source, StatedErrors};
use shared::model::FURTHER;
use shared::rectification::Covariance;
use shared::wire::board::{Cause, TimeBase};
use shared::wire::configuration::{
    Calibration, Certified, Compensation, Configuration, Date, Name, Provenance,
};
use shared::wire::message::{Coefficients, Refusal};

const CLOCK_HZ: u32 = 8_192_000;

const fn milliseconds(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

/// Instrument and reference tell 0.8 g along IA and 0.6 g along PA, at 0.1 V/g.
fn at_rest(conversion: u64) -> [i32; 4] {
    let code = |g: f64| (g * 0.1 / 1.2 * 8_388_608.0) as i32 + (conversion % 7) as i32;
    [code(0.8), code(0.8), code(0.6), code(0.0)]
}

/// A board that is powered and not yet greeted.
fn powered() -> Result<Emulator, Error> {
    Emulator::start(Plain::new(CLOCK_HZ, at_rest))
}

fn greeted() -> Result<Conversation, Error> {
    Conversation::with_board(powered()?)
}

/// Compensation that is calibrated from 10 to 40 degrees.
fn certified() -> Certified {
    let mut nominal = [0.0; 11];
    nominal[0] = 0.1;
    Certified {
        configuration: Configuration {
            compensation: Compensation {
                mode: Some(Mode::Block),
                source: Source::Reference,
                block_samples: 40,
                nominal_v_per_g: 0.1,
                reference_v_per_g: [0.1; 3],
                reference_zero_v: [0.0; 3],
            },
            calibration: Some(Calibration {
                coefficients: Coefficients {
                    nominal,
                    further: [0.0; FURTHER],
                },
                covariance: Covariance::default(),
                rank: 11,
            }),
        },
        provenance: Some(Provenance {
            serial: Name::new("V00007").expect("a name"),
            date: Date {
                year: 2026,
                month: 2,
                day: 28,
            },
            campaign: [0; 32],
            temperature_c: Some([10.0, 40.0]),
            accepted_by: None,
        }),
        errors: StatedErrors {
            bias_g_per_k: 1e-5,
            bias_drift_g: 3e-5,
            ..StatedErrors::default()
        },
    }
}

/// The qualities of compensated blocks, and the uncertainties that are stated with them.
fn worth(heard: &[Heard]) -> (Vec<Quality>, Vec<Option<f32>>) {
    let qualities = heard.iter().filter_map(|heard| match heard {
        Heard::Compensated(block) => Some(block.quality),
        _ => None,
    });
    let sigmas = heard.iter().filter_map(|heard| match heard {
        Heard::Conditions(conditions) => Some(conditions.sigma_g),
        _ => None,
    });
    (qualities.collect(), sigmas.collect())
}

#[test]
fn caches_and_prefetch_are_on() -> Result<(), Error> {
    const FLASH_ACR: u64 = 0x4002_3C00;
    let mut host = greeted()?;
    let control = host.board.read_word(FLASH_ACR)?;
    // Five wait states, prefetch, instruction cache, data cache.
    assert_eq!(control & 0x70F, 0x705, "{control:#x}");
    Ok(())
}

#[test]
fn the_link_runs_at_one_megabaud_exactly() -> Result<(), Error> {
    const USART3_BRR: u64 = 0x4000_4808;
    let mut host = greeted()?;
    // 42 MHz over 16 times 2 and 10 sixteenths.
    assert_eq!(host.board.read_word(USART3_BRR)?, 42);
    Ok(())
}

#[test]
fn without_the_debuggers_clock_the_board_measures_and_says_that_its_time_is_unsure()
-> Result<(), Error> {
    let mut board = powered()?;
    board.intervene(|session, _, _| session.board_mut().external_clock = false)?;
    board.run_for(milliseconds(400))?;
    let mut host = Conversation::with_board(board)?;
    let told = host.board_state()?.expect("an answer");
    assert_eq!(told.time_base, TimeBase::Internal);
    host.replace(Some(certified()))?;
    host.listen(milliseconds(20))?;
    host.heard();
    host.listen(milliseconds(200))?;
    let (qualities, _) = worth(&host.heard());
    assert!(qualities.len() > 15);
    let unsure = Quality(Quality::TIME_BASE);
    assert!(qualities.iter().all(|q| *q == unsure), "{qualities:?}");
    Ok(())
}

#[test]
fn a_clock_that_stops_restarts_the_board_on_its_own_and_is_told() -> Result<(), Error> {
    let mut host = greeted()?;
    let told = host.board_state()?.expect("an answer");
    assert_eq!(told.time_base, TimeBase::External);
    assert_eq!((told.cause, told.boots), (Cause::Power, 1));
    host.board
        .intervene(|session, _, stop| session.board_mut().stop_clock(stop.at))?;
    // The slow clock makes everything slow until the loss is seen.
    host.listen(milliseconds(3000))?;
    assert!(host.greet()? || host.greet()?);
    let told = host.board_state()?.expect("an answer");
    assert_eq!((told.cause, told.boots), (Cause::ClockLost, 2));
    assert_eq!(told.time_base, TimeBase::Internal);
    Ok(())
}

#[test]
fn the_reset_button_is_told_and_counted() -> Result<(), Error> {
    let mut host = greeted()?;
    for boots in 2..4 {
        host.board.reset()?;
        host.listen(milliseconds(30))?;
        assert!(host.greet()? || host.greet()?);
        let told = host.board_state()?.expect("an answer");
        assert_eq!((told.cause, told.boots), (Cause::Pin, boots));
    }
    Ok(())
}

#[test]
fn option_bytes_without_brown_out_level_3_are_told() -> Result<(), Error> {
    const FLASH: u64 = 0x4002_3C00;
    const OPTKEYR: u64 = FLASH + 0x08;
    const OPTCR: u64 = FLASH + 0x14;
    let mut host = greeted()?;
    let told = host.board_state()?.expect("an answer");
    assert!(!told.brown_out_guarded);
    let options = host.board.read_word(OPTCR)?;
    for key in [0x0819_2A3B, 0x4C5D_6E7F] {
        host.board.write_word(OPTKEYR, key)?;
    }
    let level_3 = options & !0b1111;
    host.board.write_word(OPTCR, level_3)?;
    host.board.write_word(OPTCR, level_3 | 0b10)?;
    host.listen(milliseconds(5))?;
    host.board.reset()?;
    host.listen(milliseconds(30))?;
    assert!(host.greet()? || host.greet()?);
    let told = host.board_state()?.expect("an answer");
    assert!(told.brown_out_guarded);
    Ok(())
}

#[test]
fn the_write_protect_jumper_keeps_the_memory() -> Result<(), Error> {
    let mut host = greeted()?;
    host.board
        .intervene(|session, _, stop| session.board_mut().protect(stop.at, true))?;
    host.listen(milliseconds(10))?;
    host.heard();
    host.replace(Some(certified()))?;
    let refused = |heard: &Heard| matches!(heard, Heard::Refused(_, Refusal::Protected));
    assert!(host.heard().iter().any(refused));
    assert!(host.board_state()?.expect("an answer").write_protected);
    Ok(())
}

#[test]
fn a_line_that_takes_nothing_costs_frames_that_are_counted_and_nothing_else() -> Result<(), Error> {
    const USART3_CR1: u64 = 0x4000_480C;
    const ENABLED: u32 = 1 << 13;
    let mut host = greeted()?;
    let before = host.state()?.expect("an answer");
    let control = host.board.read_word(USART3_CR1)?;
    host.board.write_word(USART3_CR1, control & !ENABLED)?;
    // Longer than the watchdog waits.
    host.listen(milliseconds(5000))?;
    host.board.write_word(USART3_CR1, control)?;
    host.listen(milliseconds(300))?;
    assert!(host.greet()? || host.greet()?);
    let after = host.state()?.expect("an answer");
    let told = host.board_state()?.expect("an answer");
    assert_eq!((told.cause, told.boots), (Cause::Power, 1));
    assert!(told.line_timeouts >= 10, "{told:?}");
    assert_eq!(after.lost, before.lost);
    assert!(after.dropped_samples > 0);
    Ok(())
}

#[test]
fn a_full_log_that_no_probe_reads_holds_nothing_up() -> Result<(), Error> {
    let mut host = greeted()?;
    let id = u32::from_le_bytes(*b"SEGG");
    let mut block = None;
    for address in (0x2000_0000u64..0x2001_0000).step_by(4) {
        if host.board.read_memory(address)? == id {
            block = Some(address);
            break;
        }
    }
    let block = block.expect("the log's control block");
    // The first channel: name, buffer, size, write, read, flags.
    let channel = block + 24;
    let size = host.board.read_memory(channel + 8)?;
    let read = host.board.read_memory(channel + 16)?;
    let full = (read + size - 1) % size;
    host.board.write_memory(channel + 12, full)?;
    // As a probe leaves it: the program is to wait until there is room.
    host.board.write_memory(channel + 20, 2)?;
    // What logs.
    host.replace(Some(certified()))?;
    host.listen(milliseconds(1500))?;
    let told = host.board_state()?.expect("an answer");
    assert_eq!((told.cause, told.boots), (Cause::Power, 1));
    Ok(())
}

#[test]
fn a_pulse_a_second_is_stamped_to_the_microsecond_and_goes_with_each_block() -> Result<(), Error> {
    let mut host = greeted()?;
    assert_eq!(host.board_state()?.expect("an answer").pulse, None);
    let mut stamps = Vec::new();
    for _ in 0..3 {
        host.board
            .intervene(|session, _, stop| session.board_mut().drive_pulse(stop.at, true))?;
        let begun = host.board.now();
        host.listen(milliseconds(1))?;
        host.board
            .intervene(|session, _, stop| session.board_mut().drive_pulse(stop.at, false))?;
        host.listen(milliseconds(40))?;
        let pulse = host.heard().iter().rev().find_map(|heard| match heard {
            Heard::Conditions(conditions) => conditions.pulse,
            _ => None,
        });
        stamps.push((pulse.expect("a pulse"), begun));
        host.listen(milliseconds(100))?;
    }
    let (first, begun) = stamps[0];
    for (n, (pulse, at)) in stamps.iter().enumerate() {
        assert_eq!(pulse.count, n as u32 + 1);
        let passed_us = (*at - begun).as_micros() as u64;
        let counted_us = pulse.time_us - first.time_us;
        assert!(
            counted_us.abs_diff(passed_us) <= 1,
            "{counted_us} {passed_us}"
        );
    }
    Ok(())
}

#[test]
fn temperature_is_told_and_outside_of_the_calibrated_range_blocks_say_so() -> Result<(), Error> {
    let mut host = greeted()?;
    host.replace(Some(certified()))?;
    for (celsius, flag) in [(25, 0), (60, Quality::TEMPERATURE)] {
        host.board.intervene(move |session, _, _| {
            let mcu = session.board_mut().f427().expect("the board is an F429");
            let (sensor, _) = mcu.converter(0);
            sensor.set_temperature(100 * celsius);
        })?;
        host.listen(milliseconds(1500))?;
        let told = host.board_state()?.expect("an answer");
        let board_c = told.board_c.expect("a sensor");
        assert!((board_c - celsius as f32).abs() < 1.0, "{board_c}");
        host.heard();
        host.listen(milliseconds(100))?;
        let (qualities, sigmas) = worth(&host.heard());
        assert!(qualities.len() > 5);
        assert!(
            qualities.iter().all(|q| *q == Quality(flag)),
            "{qualities:?}"
        );
        // From the middle of the range, and what the bias drifts in any case.
        let away = f64::from(board_c) - 25.0;
        let expected = (1e-5 * away).hypot(3e-5);
        for sigma in sigmas {
            let sigma = f64::from(sigma.expect("compensated"));
            assert!((sigma / expected - 1.0).abs() < 1e-3, "{sigma} {expected}");
        }
    }
    Ok(())
}
