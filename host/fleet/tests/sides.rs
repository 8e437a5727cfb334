//! Which side an effect belongs to, over batches of 20 campaigns.

use fleet::sides::{Detection, Finding, Side, attribute};
use host::bench::noise::Seed;

/// Twenty campaigns of as many instruments on two benches, four fixtures and ten days; the effect follows `side`, with a share of its
/// words bearing it, and the diagnosis misses it as often as `missed`, by values that its sigma states.
fn batch(seed: u64, side: Side) -> Vec<Finding> {
    let mut stream = Seed(seed).stream("batch", side as u64);
    let words = [20, 2, 4, 10];
    let of = |number: usize| [number, number % 2, (number * 7 / 3) % 4, number / 2];
    let groups = words[side as usize];
    // Some bear it, not all.
    let first = stream.index(groups);
    let bears: Vec<bool> = (0..groups)
        .map(|k| k == first || (k + 1 != first && stream.index(2) == 0))
        .collect();
    let value: Vec<f64> = (0..groups).map(|_| stream.uniform(400.0, 1600.0)).collect();
    (0..20)
        .map(|number| {
            let places = of(number);
            let group = places[side as usize];
            let found = if bears[group] {
                stream.index(20) != 0
            } else {
                stream.index(50) == 0
            };
            let sigma = 20.0;
            let centre = if bears[group] {
                value[group]
            } else {
                stream.uniform(400.0, 1600.0)
            };
            let seen = centre + sigma * stream.normal();
            Finding {
                shared: places.map(|place| Some(place.to_string())),
                values: found.then(|| vec![(seen, sigma)]),
            }
        })
        .collect()
}

fn right(side: Side, detection: Detection) -> f64 {
    const BATCHES: u64 = 200;
    let right = (0..BATCHES).filter(|seed| {
        let told = attribute("effect", &batch(*seed, side), detection);
        let best = told.sides.iter().max_by(|a, b| a.1.total_cmp(b.1));
        best.is_some_and(|(best, _)| *best == side)
    });
    right.count() as f64 / BATCHES as f64
}

#[test]
fn the_side_is_right_in_95_percent_of_batches_of_20() {
    for side in Side::ALL {
        let share = right(side, Detection::default());
        println!("{}: {share}", side.word());
        assert!(share >= 0.95, "{side:?}: {share}");
    }
}

#[test]
fn halved_rates_of_detection_change_no_verdict() {
    let halved = Detection {
        missed: 0.05,
        false_alarm: 0.01,
    };
    for side in Side::ALL {
        let share = right(side, halved);
        assert!(
            (share - right(side, Detection::default())).abs() < 0.05,
            "{side:?}: {share}"
        );
    }
}

#[test]
fn sides_that_group_the_campaigns_alike_cannot_be_told_apart_and_are_named() {
    let mut findings = batch(1, Side::Bench);
    for finding in &mut findings {
        let [_, bench, fixture, day] = &mut finding.shared;
        fixture.clone_from(bench);
        *day = None;
    }
    let told = attribute("effect", &findings, Detection::default());
    assert_eq!(told.same_as.get(&Side::Fixture), Some(&Side::Bench));
    assert!(!told.sides.contains_key(&Side::Day));
    let sum: f64 = told.sides.values().sum();
    assert!((sum - 1.0).abs() < 1e-12, "{sum}");
}
