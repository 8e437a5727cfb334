//! The walk through a static test, without an instrument: what follows from what, and whether its judgements hold.

use host::bench::noise::Seed;
use host::bench::plan::{Dwell, Static, dwells};
use host::bench::simulate::{Specification, VirtualBench};
use host::campaign::{Approach, CampaignConfig, Reading};
use host::capture::{read_plan, write_plan, write_sheet};
use host::statics::Environment;
use host::walk::{Counts, Order, Phase, RED, Settings, StopState, View, Walk, Wish};
use shared::model::SpecificForce;
use shared::rectification::Sensitivity;
use shared::vibration::Random;
use shared::wire::message::{Block, Moments, Segment};

/// Blocks of a reading, and their length, s.
const BLOCKS: u32 = 20;
const BLOCK_S: f64 = 0.01;
/// The output of a code, V.
const V_PER_CODE: f64 = 1e-6;

fn environment() -> Environment {
    let along = SpecificForce::new(1.0, 0.0, 0.0);
    Environment {
        name: "random:1".into(),
        a0_i_g: 0.0,
        moments: Random::along(along).into(),
    }
}

/// A walk, the readings that its bench gives, and the time.
struct Test {
    walk: Walk,
    readings: Vec<Reading>,
    taken: Vec<Reading>,
    now_s: f64,
    first_sample: u64,
}

fn bench(seed: u64, plan: Static) -> VirtualBench {
    VirtualBench::new(
        Seed(seed),
        plan,
        Specification::with_dial_sigma(5.8),
        Vec::new(),
    )
}

fn new_walk(config: CampaignConfig, plan: &[Dwell]) -> Walk {
    let settings = Settings {
        settle_s: 0.1,
        dwell_s: BLOCK_S * f64::from(BLOCKS),
        blocks: BLOCKS,
        v_per_code: V_PER_CODE,
        environment: environment(),
        enough: Some(0.1),
    };
    Walk::new(config, settings, plan, 0, 22.0)
}

impl Test {
    fn new(plan: Static) -> Self {
        let bench = bench(1, plan);
        let campaign = bench.simulate().campaign;
        Self {
            walk: new_walk(campaign.config, &dwells(plan)),
            readings: campaign.readings,
            taken: Vec::new(),
            now_s: 0.0,
            first_sample: 0,
        }
    }

    /// A block of this output.
    fn block(&mut self, segment: Segment, output_v: f64) {
        self.now_s += BLOCK_S;
        let mut moments = Moments::default();
        moments.sum[0] = (40.0 * output_v / V_PER_CODE).round() as i64;
        let block = Block {
            segment,
            first_sample: self.first_sample,
            count: 40,
            lost: 0,
            moments,
        };
        self.first_sample += 40;
        self.walk.block(&block, self.now_s);
        self.walk.tick(self.now_s);
    }

    fn wish(&mut self, wish: Wish) {
        self.walk.wish(wish, self.now_s);
    }

    fn view(&self) -> View {
        self.walk.view(self.now_s, Counts::default())
    }

    /// The bench's reading at this position.
    fn at(&self, dwell: &Dwell) -> Reading {
        let there = |r: &&Reading| {
            (r.series, r.dial_deg, r.mount_deg, r.approach)
                == (
                    dwell.series,
                    dwell.dial_deg,
                    dwell.mount_deg,
                    dwell.approach,
                )
        };
        self.readings
            .iter()
            .find(there)
            .cloned()
            .expect("a position of the plan")
    }

    /// Measures the position that is next, with this output instead of the bench's.
    fn measure_as(&mut self, output_v: Option<f64>) -> u32 {
        self.wish(Wish::Measure);
        let mut number = None;
        for _ in 0..100 {
            let segment = number.map_or(Segment::Idle, Segment::Reading);
            self.block(segment, output_v.unwrap_or(0.5));
            for order in self.walk.orders() {
                match order {
                    Order::Begin { reading, .. } => number = Some(reading),
                    Order::End { reading } => {
                        let dwell = *self.walk.stops().dwell().expect("a stop");
                        let mut row = self.at(&dwell);
                        row.order = u64::from(reading);
                        row.output_v = output_v.unwrap_or(row.output_v);
                        self.taken.push(row);
                        self.walk.whole(&self.taken);
                        return reading;
                    }
                    Order::Withdraw { reading } => {
                        self.taken.retain(|row| row.order != u64::from(reading));
                    }
                    order => panic!("{order:?}"),
                }
            }
        }
        panic!("no reading comes: {:?}", self.walk.phase());
    }

    fn measure(&mut self) -> u32 {
        self.measure_as(None)
    }
}

#[test]
fn a_walk_measures_each_position_once_in_the_order_of_the_plan_and_is_over() {
    let mut test = Test::new(Static::Paper);
    let plan = dwells(Static::Paper);
    for (order, dwell) in plan.iter().enumerate() {
        assert_eq!(test.walk.stops().dwell(), Some(dwell));
        assert_eq!(test.measure(), order as u32);
    }
    assert_eq!(test.walk.orders(), [Order::Finish]);
    assert_eq!(*test.walk.phase(), Phase::Over);
    assert!(
        test.walk
            .stops()
            .all()
            .iter()
            .all(|(_, s)| matches!(s, StopState::Taken(_)))
    );
    assert_eq!(test.walk.stops().missing(), 0);
    assert!(test.view().readings.iter().all(|reading| reading.sound));
}

#[test]
fn an_output_that_moves_does_not_settle_and_its_time_begins_anew() {
    let mut test = Test::new(Static::Paper);
    test.wish(Wish::Measure);
    for n in 0..200 {
        test.block(Segment::Idle, 0.01 * f64::from(n));
        assert!(test.walk.orders().is_empty());
    }
    for _ in 0..8 {
        test.block(Segment::Idle, 2.0);
    }
    assert!(test.walk.orders().is_empty(), "0.08 s are not 0.1 s");
    assert!((test.view().steady_s - 0.07).abs() < 0.011);
    for _ in 0..5 {
        test.block(Segment::Idle, 2.0);
    }
    assert!(matches!(
        test.walk.orders()[..],
        [Order::Begin { reading: 0, .. }]
    ));
}

#[test]
fn a_redone_reading_is_withdrawn_and_its_position_is_next() {
    let mut test = Test::new(Static::Paper);
    for _ in 0..3 {
        test.measure();
    }
    test.wish(Wish::Redo { reading: Some(1) });
    assert_eq!(test.walk.stops().at(), Some(1));
    assert_eq!(test.measure(), 3);
    assert_eq!(test.walk.stops().at(), Some(3));
    let numbers: Vec<u32> = test.view().readings.iter().map(|r| r.reading).collect();
    assert_eq!(numbers, [0, 2, 3]);
    // The last one, and one that is not there.
    test.wish(Wish::Redo { reading: None });
    assert_eq!(test.walk.orders(), [Order::Withdraw { reading: 3 }]);
    test.wish(Wish::Redo { reading: Some(77) });
    assert!(test.view().message.contains("77"));
    assert!(test.walk.orders().is_empty());
}

#[test]
fn skip_pause_and_another_series_go_where_they_say() {
    let mut test = Test::new(Static::Paper);
    test.wish(Wish::Skip);
    assert_eq!(test.walk.stops().at(), Some(1));
    test.wish(Wish::Pause);
    assert_eq!(*test.walk.phase(), Phase::Paused);
    test.wish(Wish::SwapSeries);
    let dwell = *test.walk.stops().dwell().expect("a stop");
    assert_eq!((u8::from(dwell.series), dwell.dial_deg), (2, 0.0));
    // What was left out can be chosen, what was measured not.
    test.wish(Wish::Choose { stop: 0 });
    assert_eq!(test.walk.stops().at(), Some(0));
    test.measure();
    test.wish(Wish::Choose { stop: 0 });
    assert_eq!(test.walk.stops().at(), Some(1));
    assert!(test.view().message.contains("redo"));
    // In the middle of a reading: it does not count.
    test.wish(Wish::Measure);
    for _ in 0..15 {
        test.block(Segment::Idle, 0.5);
    }
    let orders = test.walk.orders();
    assert!(
        matches!(orders[..], [Order::Begin { reading: 1, .. }]),
        "{orders:?}"
    );
    test.wish(Wish::Pause);
    assert_eq!(test.walk.orders(), [Order::Abandon { reading: 1 }]);
    assert_eq!(*test.walk.phase(), Phase::Paused);
    assert_eq!(test.measure(), 2);
}

#[test]
fn a_lost_instrument_costs_the_reading_under_way_alone() {
    let mut test = Test::new(Static::Paper);
    test.measure();
    test.wish(Wish::Measure);
    for _ in 0..15 {
        test.block(Segment::Idle, 0.5);
    }
    assert!(matches!(
        test.walk.orders()[..],
        [Order::Begin { reading: 1, .. }]
    ));
    test.walk.lost("the line was closed");
    test.wish(Wish::Measure);
    assert!(
        matches!(test.walk.phase(), Phase::Lost { .. }),
        "nothing can be measured"
    );
    test.walk.found();
    assert_eq!(test.walk.stops().at(), Some(1));
    assert_eq!(test.measure(), 2);
    assert_eq!(test.view().readings.len(), 2);
}

#[test]
fn an_instrument_that_sends_no_blocks_is_not_waited_for_without_end() {
    let mut test = Test::new(Static::Paper);
    test.wish(Wish::Measure);
    for _ in 0..15 {
        test.block(Segment::Idle, 0.5);
    }
    test.walk.orders();
    test.walk.tick(test.now_s + 60.0);
    assert_eq!(test.walk.orders(), [Order::Abandon { reading: 0 }]);
    assert_eq!(*test.walk.phase(), Phase::Place);
}

#[test]
fn a_remark_goes_with_the_last_reading_and_steers_no_terminal() {
    let mut test = Test::new(Static::Paper);
    let remark = |text: &str| Wish::Remark { text: text.into() };
    test.wish(remark("cold \u{1b}[31mroom"));
    let text = "cold [31mroom".into();
    assert_eq!(
        test.walk.orders(),
        [Order::Remark {
            reading: None,
            text
        }]
    );
    test.measure();
    test.wish(remark("  touched "));
    let text = "touched".into();
    assert_eq!(
        test.walk.orders(),
        [Order::Remark {
            reading: Some(0),
            text
        }]
    );
    test.wish(remark(" "));
    assert!(test.walk.orders().is_empty());
    assert_eq!(test.view().readings[0].remark, "touched");
}

#[test]
fn a_dial_that_was_not_turned_or_stands_elsewhere_is_red_and_said() {
    let mut test = Test::new(Static::Paper);
    for _ in 0..5 {
        test.measure();
    }
    // Series 1, 225 deg next; the dial still stands at 180.
    let here = test.taken[4].output_v;
    test.measure_as(Some(here));
    let view = test.view();
    assert!(!view.readings[5].sound);
    assert!(
        view.readings[5].reason.contains("was the dial turned?"),
        "{}",
        view.readings[5].reason
    );
    test.wish(Wish::Redo { reading: None });
    // Now it stands at 240 deg.
    let output_v = test.taken[4].output_v * 240_f64.to_radians().cos() / 180_f64.to_radians().cos();
    test.measure_as(Some(output_v));
    let view = test.view();
    let reason = &view.readings[5].reason;
    assert!(
        !view.readings[5].sound && reason.contains("does the dial stand at 225 deg"),
        "{reason}"
    );
    assert!(
        reason.contains("at 240 deg") || reason.contains("at 120 deg"),
        "{reason}"
    );
}

/// Over 40 benches: once the first forty readings tell every coefficient, the standard uncertainty by which the second forty are
/// judged is what they scatter by, two-sided. Before that it rests on what is assumed of an instrument, which is wide on purpose:
/// there it is never too small. Hardly a sound reading is red.
#[test]
fn sound_readings_are_judged_by_a_standard_uncertainty_that_holds() {
    let (mut early, mut late, mut red) = (Vec::new(), Vec::new(), 0);
    for seed in 0..40 {
        let campaign = bench(seed, Static::Remounted).simulate().campaign;
        let mut walk = new_walk(campaign.config, &dwells(Static::Remounted));
        walk.take_over(&campaign.readings);
        let view = walk.view(0.0, Counts::default());
        let (first, second) = view.readings.split_at(40);
        early.extend(first.iter().map(|reading| reading.sigmas));
        late.extend(second.iter().map(|reading| reading.sigmas));
        red += view
            .readings
            .iter()
            .filter(|r| r.sigmas.abs() > RED)
            .count();
    }
    let mean_square = |sigmas: &[f64]| {
        let squares: f64 = sigmas.iter().map(|sigma| sigma * sigma).sum();
        squares / sigmas.len() as f64
    };
    // Innovations are independent of each other: four standard deviations of the mean of 1 600 squares.
    let width = 4.0 * (2.0 / late.len() as f64).sqrt();
    let (early, late) = (mean_square(&early), mean_square(&late));
    assert!((late - 1.0).abs() < width, "{late}");
    assert!(early < 1.0 + width, "{early}");
    // 3 200 times 6e-5.
    assert!(red <= 2, "{red}");
}

/// Over 60 benches: the vibration error that is shown at the end holds the true one in its interval.
#[test]
fn the_vibration_error_shown_is_as_uncertain_as_it_says() {
    let benches = 60;
    let mut squares = 0.0;
    for seed in 100..100 + benches {
        let bench = bench(seed, Static::Remounted);
        let campaign = bench.simulate().campaign;
        let mut walk = new_walk(campaign.config, &dwells(Static::Remounted));
        walk.take_over(&campaign.readings);
        let vre = walk
            .view(0.0, Counts::default())
            .vre
            .expect("a vibration error");
        let environment = environment();
        let sensitivity = Sensitivity::new(environment.a0_i_g, environment.moments);
        let truth = sensitivity.vre_g(&bench.accelerometer.coefficients);
        squares += ((vre.value_g - truth) / vre.sigma_g).powi(2);
    }
    let mean_square = squares / benches as f64;
    // Four standard deviations of a chi-square of 60 degrees of freedom over 60.
    let width = 4.0 * (2.0 / benches as f64).sqrt();
    assert!((mean_square - 1.0).abs() < width, "{mean_square}");
}

#[test]
fn positions_chosen_for_the_vibration_error_tell_it_sooner_than_those_of_the_plan() {
    let sigma_after = |best: bool| {
        let mut test = Test::new(Static::Remounted);
        for _ in 0..20 {
            if best {
                test.wish(Wish::Best);
            }
            test.measure();
        }
        test.view().vre.expect("a vibration error").sigma_g
    };
    let (in_order, chosen) = (sigma_after(false), sigma_after(true));
    assert!(chosen < 0.7 * in_order, "{chosen} {in_order}");
}

#[test]
fn enough_is_said_when_the_share_is_reached_and_not_before() {
    let mut test = Test::new(Static::Remounted);
    test.measure();
    let vre = test.view().vre.expect("a vibration error");
    assert_eq!(vre.enough, Some(false));
    while *test.walk.phase() != Phase::Over {
        test.measure();
        let vre = test.view().vre.expect("a vibration error");
        assert_eq!(vre.enough, Some(vre.sigma_g <= 0.1 * vre.value_g.abs()));
    }
    let vre = test.view().vre.expect("a vibration error");
    assert!(vre.history.windows(2).all(|pair| pair[0].0 < pair[1].0));
}

#[test]
fn a_plan_that_is_written_is_read_as_it_was_and_a_sheet_too() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("plan.csv");
    for known in [Static::Default, Static::Paper, Static::Remounted] {
        let dwells = dwells(known);
        write_plan(&file, &dwells).unwrap();
        assert_eq!(read_plan(&file).unwrap(), dwells);
        write_sheet(&file, &dwells).unwrap();
        assert_eq!(read_plan(&file).unwrap(), dwells);
    }
}

#[test]
fn without_an_approach_each_position_is_approached_from_the_one_before() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("plan.csv");
    std::fs::write(&file, "series,dial_deg\n1,0\n1,45\n1,30\n2,15\n").unwrap();
    let dwells = read_plan(&file).unwrap();
    let (up, down) = (Approach::CounterClockwise, Approach::Clockwise);
    let found: Vec<_> = dwells.iter().map(|dwell| dwell.approach).collect();
    assert_eq!(found, [up, up, down, up]);
}

#[test]
fn a_bad_approach_and_a_plan_without_a_best_one_are_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("plan");
    for (text, says) in [
        (
            "series,dial_deg,approach\n1,0,up\n",
            "row 2, column approach: \"up\"",
        ),
        (
            "series,dial_deg,approach\n1,0,cw\n1,3,\n",
            "row 3, column approach: is empty",
        ),
        ("{\"format\": \"vre-plan/1\"}", "no best plan"),
        ("{\"best\": {\"positions\": []}}", "no positions"),
        ("{", "plan: "),
    ] {
        std::fs::write(&file, text).unwrap();
        let told = read_plan(&file).unwrap_err().to_string();
        assert!(told.contains(says), "{told}");
    }
}
