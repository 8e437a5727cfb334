//! Both directions of the line, through the firmware's sampler and application: hostile commands and bytes go in, and all
//! that comes out must be sound frames that tell what can be.

use std::path::Path;

use arbitrary::Unstructured;
use firmware::adc::Conversion;
use firmware::adc::batch::Batch;
use firmware::app::App;
use firmware::link::Queues;
use firmware::sampler::Sampler;
use firmware::store::Kept;
use shared::compensate::{Mode, Quality, Source, StatedErrors};
use shared::model::{FURTHER, NOMINAL};
use shared::rectification::Covariance;
use shared::wire::configuration::{
    Calibration, Certified, Coefficients, Compensation, Configuration,
};
use shared::wire::framing::{Frame, Packet};
use shared::wire::message::{Command, CompensatedBlock, Event, Identity, Run};
use shared::wire::version;

use crate::draw::{below, number, one_in, one_of, spoil, unit};
use crate::{Fuzz, Judged};

const IDENTITY: Identity = Identity {
    minimum: version::MINIMUM,
    current: version::CURRENT,
    firmware: [0, 1, 0],
    serial: *b"123456789012",
    sample_rate_hz: 4000.0,
    reference_v: 1.2,
    gains: [1; 4],
    block_samples: 40,
};

/// Exchanges of one input.
const EXCHANGES: usize = 24;

/// The target: each input is an instrument of its own.
pub struct Wire;

/// A number that a command may carry: hostile, or near a sound one.
fn hostile(draw: &mut Unstructured<'_>, sound: f64) -> f64 {
    match one_in(draw, 3) {
        true => number(draw, &sound.to_string()).parse().unwrap_or(sound),
        false => sound,
    }
}

fn coefficients(draw: &mut Unstructured<'_>) -> Coefficients {
    let mut nominal = [1e-5; NOMINAL];
    nominal[0] = 0.12;
    Coefficients {
        nominal: nominal.map(|sound| hostile(draw, sound)),
        further: [0.0; FURTHER].map(|sound| hostile(draw, sound)),
    }
}

/// To compensate with coefficients some of which are hostile.
fn replace(draw: &mut Unstructured<'_>, writes: u32) -> Command {
    let calibration = Calibration {
        coefficients: coefficients(draw),
        covariance: Covariance::default(),
        rank: 11,
    };
    let narrow = |x: f64| x as f32;
    let configuration = Configuration {
        compensation: Compensation {
            mode: Some(*one_of(draw, &[Mode::Block, Mode::Pointwise])),
            source: *one_of(draw, &[Source::Reference, Source::Instrument]),
            block_samples: *one_of(draw, &[0, 3, 4, 40, 400, u16::MAX]),
            nominal_v_per_g: narrow(hostile(draw, 0.12)),
            reference_v_per_g: [0.1; 3].map(|sound| narrow(hostile(draw, sound))),
            reference_zero_v: [0.0; 3].map(|sound| narrow(hostile(draw, sound))),
        },
        calibration: (!one_in(draw, 8)).then_some(calibration),
    };
    let certified = Certified {
        configuration,
        provenance: None,
        errors: StatedErrors::default(),
    };
    Command::Replace {
        writes,
        certified: Some(certified),
    }
}

fn command(draw: &mut Unstructured<'_>, writes: u32) -> Option<Command> {
    match below(draw, 8) {
        0 | 1 => Some(replace(draw, writes)),
        2 => Some(Command::SetCoefficients(coefficients(draw))),
        3 => Some(Command::Hello {
            version: version::CURRENT,
        }),
        4 => Some(Command::StopRun),
        // Whatever bytes mean.
        _ => {
            let bytes: [u8; 64] = draw.arbitrary().unwrap_or([0; 64]);
            postcard::from_bytes(&bytes).ok()
        }
    }
}

/// An instrument whose conversions are made by hand.
struct Instrument<'q> {
    sampler: Sampler<'q>,
    app: App<'q>,
    next: u64,
    sequence: u16,
    writes: u32,
}

impl Instrument<'_> {
    fn send(&mut self, command: &Command, spoilt: Option<&mut Unstructured<'_>>) -> Judged {
        let mut frame = Frame::new();
        frame
            .encode(command, self.sequence)
            .map_err(|error| format!("{command:?} cannot be sent: {error:?}"))?;
        self.sequence = self.sequence.wrapping_add(1);
        let mut bytes = frame.as_bytes().to_vec();
        if let Some(draw) = spoilt {
            spoil(draw, &mut bytes);
        }
        self.app.receive(&bytes);
        Ok(())
    }

    fn convert(&mut self, draw: &mut Unstructured<'_>, count: u64) {
        // Gravity, a vibration, and now and then the ends of the converter's range.
        let end = one_in(draw, 6);
        let (rest, level) = (1e6 * unit(draw), 6e6 * unit(draw));
        for _ in 0..count {
            self.sampler.obey(self.next, || 250 * self.next);
            let index = self.next;
            self.next += 1;
            let wave = (rest + level * (0.7 * index as f64).sin()) as i32;
            let code = match end {
                true => *[-8_388_608, 8_388_607]
                    .get(index as usize % 2)
                    .unwrap_or(&0),
                false => wave.clamp(-8_388_608, 8_388_607),
            };
            self.sampler.take(&Batch::new(&Conversion {
                index,
                time_us: 250 * index,
                codes: [code, code / 2, -code / 3, code / 5],
            }));
        }
    }

    /// All that it says, judged.
    fn listen(&mut self) -> Judged {
        self.sampler.obey(self.next, || 250 * self.next);
        let mut frame = Frame::new();
        while self.app.transmit(&mut frame) {
            let mut bytes = frame.as_bytes().to_vec();
            if bytes.pop() != Some(0) {
                return Err("a frame without its delimiter".into());
            }
            let packet = Packet::open(&mut bytes).map_err(|e| format!("a frame said: {e:?}"))?;
            let event = packet
                .message()
                .map_err(|e| format!("an event said: {e:?}"))?;
            judge(&event)?;
        }
        if self.app.keep().is_some() {
            self.writes += 1;
            self.app.stored(Kept {
                writes: self.writes,
                fault: None,
            });
        }
        Ok(())
    }
}

/// What is compensated is a number, or says that it is none.
fn judge(event: &Event<'_>) -> Judged {
    let Event::Compensated(block) = event else {
        return Ok(());
    };
    let CompensatedBlock {
        specific_force_g,
        vre_g,
        vre_sigma_g,
        quality,
        ..
    } = *block;
    let none = quality.has(Quality::NO_SOLUTION);
    let finite = specific_force_g.is_finite() && vre_g.is_finite();
    let sigma = vre_sigma_g >= 0.0 && (vre_sigma_g.is_finite() || !quality.is_sound());
    match none || finite && sigma {
        true => Ok(()),
        false => Err(format!("compensated to {block:?}")),
    }
}

impl Fuzz for Wire {
    fn input(&mut self, draw: &mut Unstructured<'_>) -> Judged {
        let mut queues = Queues::new();
        let (acquisition, application) = queues.split();
        let mut instrument = Instrument {
            sampler: Sampler::new(acquisition, IDENTITY.block_samples),
            app: App::new(IDENTITY, application),
            next: 0,
            sequence: 0,
            writes: 0,
        };
        if !one_in(draw, 10) {
            instrument.send(
                &Command::Hello {
                    version: version::CURRENT,
                },
                None,
            )?;
        }
        for _ in 0..EXCHANGES {
            if let Some(command) = command(draw, instrument.writes) {
                let spoilt = one_in(draw, 10);
                instrument.send(&command, spoilt.then_some(&mut *draw))?;
            }
            if one_in(draw, 12) {
                let bytes: [u8; 32] = draw.arbitrary().unwrap_or([0; 32]);
                instrument.app.receive(&bytes);
            }
            instrument.listen()?;
            if one_in(draw, 3) {
                let run = Run {
                    run: 1,
                    plateau: shared::wire::message::Plateau::During,
                };
                instrument.send(&Command::StartRun(run), None)?;
            }
            instrument.convert(draw, 100);
            instrument.listen()?;
        }
        Ok(())
    }

    fn file(&mut self, path: &Path) -> Judged {
        let bytes = std::fs::read(path).map_err(|error| error.to_string())?;
        self.input(&mut Unstructured::new(&bytes))
    }
}
