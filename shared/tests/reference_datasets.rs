//! The triangular factor against the linear reference data sets of NIST (Statistical Reference Datasets): certified
//! coefficients, their standard deviations and the residual standard deviation.

use shared::identify::square_root::{TriangularFactor, storage_len};

/// What a least-squares fit gives, and what NIST certifies.
struct Fit<const N: usize> {
    coefficients: [f64; N],
    sigma: [f64; N],
    residual_sigma: f64,
}

/// Rows of N terms and the response.
fn fit<const N: usize, const W: usize>(rows: &[[f64; W]]) -> Fit<N> {
    assert_eq!(W, N + 1);
    let mut factor = TriangularFactor::new(N, vec![0.0; storage_len(N)]).unwrap();
    for row in rows {
        factor.absorb(&mut row.clone());
    }
    let mut coefficients = [0.0; N];
    factor.solve(0, &mut coefficients).unwrap();
    let freedom = (rows.len() - N) as f64;
    let residual_sigma = (factor.residual_squares() / freedom).sqrt();
    // Columns of R^-1; the variance of an unknown is the sum of squares of its row.
    let (r, _) = factor.trailing::<N>();
    let mut variance = [0.0; N];
    for column in 0..N {
        let mut x = [0.0; N];
        for k in (0..=column).rev() {
            let known: f64 = (k + 1..=column).map(|j| r[k][j] * x[j]).sum();
            x[k] = (f64::from(u8::from(k == column)) - known) / r[k][k];
            variance[k] += x[k] * x[k];
        }
    }
    Fit {
        coefficients,
        sigma: variance.map(|v| residual_sigma * v.sqrt()),
        residual_sigma,
    }
}

/// Fewest correct digits of `found`.
fn digits(found: &[f64], certified: &[f64]) -> f64 {
    let each = found.iter().zip(certified).map(|(f, c)| {
        let miss = ((f - c) / c).abs();
        -miss.max(1e-15).log10()
    });
    each.fold(f64::INFINITY, f64::min)
}

/// Response, deflator of the national product, product, unemployed, armed forces, population, year.
const LONGLEY: [[f64; 7]; 16] = [
    [60323.0, 83.0, 234289.0, 2356.0, 1590.0, 107608.0, 1947.0],
    [61122.0, 88.5, 259426.0, 2325.0, 1456.0, 108632.0, 1948.0],
    [60171.0, 88.2, 258054.0, 3682.0, 1616.0, 109773.0, 1949.0],
    [61187.0, 89.5, 284599.0, 3351.0, 1650.0, 110929.0, 1950.0],
    [63221.0, 96.2, 328975.0, 2099.0, 3099.0, 112075.0, 1951.0],
    [63639.0, 98.1, 346999.0, 1932.0, 3594.0, 113270.0, 1952.0],
    [64989.0, 99.0, 365385.0, 1870.0, 3547.0, 115094.0, 1953.0],
    [63761.0, 100.0, 363112.0, 3578.0, 3350.0, 116219.0, 1954.0],
    [66019.0, 101.2, 397469.0, 2904.0, 3048.0, 117388.0, 1955.0],
    [67857.0, 104.6, 419180.0, 2822.0, 2857.0, 118734.0, 1956.0],
    [68169.0, 108.4, 442769.0, 2936.0, 2798.0, 120445.0, 1957.0],
    [66513.0, 110.8, 444546.0, 4681.0, 2637.0, 121950.0, 1958.0],
    [68655.0, 112.6, 482704.0, 3813.0, 2552.0, 123366.0, 1959.0],
    [69564.0, 114.2, 502601.0, 3931.0, 2514.0, 125368.0, 1960.0],
    [69331.0, 115.7, 518173.0, 4806.0, 2572.0, 127852.0, 1961.0],
    [70551.0, 116.9, 554894.0, 4007.0, 2827.0, 130081.0, 1962.0],
];

#[test]
fn longleys_collinear_data_give_the_certified_values() {
    let rows = LONGLEY.map(|[y, a, b, c, d, e, f]| [1.0, a, b, c, d, e, f, y]);
    let found = fit::<7, 8>(&rows);
    let coefficients = [
        -3482258.63459582,
        15.0618722713733,
        -0.0358191792925910,
        -2.02022980381683,
        -1.03322686717359,
        -0.0511041056535807,
        1829.15146461355,
    ];
    let sigma = [
        890420.383607373,
        84.9149257747669,
        0.0334910077722432,
        0.488399681651699,
        0.214274163161675,
        0.226073200069370,
        455.478499142212,
    ];
    // The condition number of 5e9 costs ten of sixteen digits at the worst, and in fact five.
    assert!(digits(&found.coefficients, &coefficients) > 10.0);
    assert!(digits(&found.sigma, &sigma) > 10.0);
    assert!(digits(&[found.residual_sigma], &[304.854073561965]) > 12.0);
}

/// What Wampler added to a polynomial of the fifth degree at 0, 1 ... 20; orthogonal to it.
const NOISE: [f64; 21] = [
    759.0, -2048.0, 2048.0, -2048.0, 2523.0, -2048.0, 2048.0, -2048.0, 1838.0, -2048.0, 2048.0,
    -2048.0, 1838.0, -2048.0, 2048.0, -2048.0, 2523.0, -2048.0, 2048.0, -2048.0, 759.0,
];

fn wampler(coefficients: [f64; 6], noise: f64) -> Fit<6> {
    let rows: [[f64; 7]; 21] = std::array::from_fn(|n| {
        let power: [f64; 6] = std::array::from_fn(|k| (n as f64).powi(k as i32));
        let y: f64 = power.iter().zip(coefficients).map(|(p, c)| p * c).sum();
        let mut row = [0.0; 7];
        row[..6].copy_from_slice(&power);
        row[6] = y + noise * NOISE[n];
        row
    });
    fit::<6, 7>(&rows)
}

#[test]
fn wamplers_polynomials_come_back_through_noise_a_million_times_larger() {
    // Wampler 1 and 2, exact; 3, 4 and 5 with noise.
    let decimal = [1.0, 0.1, 0.01, 1e-3, 1e-4, 1e-5];
    for (coefficients, noise, least) in [
        ([1.0; 6], 0.0, 9.0),
        (decimal, 0.0, 11.0),
        ([1.0; 6], 1.0, 9.0),
        ([1.0; 6], 1e2, 7.0),
        ([1.0; 6], 1e4, 5.0),
    ] {
        let found = wampler(coefficients, noise);
        let correct = digits(&found.coefficients, &coefficients);
        println!("noise {noise}: {correct:.1} digits");
        assert!(correct > least, "noise {noise}: {correct} digits");
        if noise > 0.0 {
            let sigma = [
                2152.32624678170,
                2363.55173469681,
                779.343524331583,
                101.475507550350,
                5.64566512170752,
                0.112324854679312,
            ];
            assert!(digits(&found.sigma, &sigma.map(|s| noise * s)) > 11.0);
            let residual = [noise * 2360.14502379268];
            assert!(digits(&[found.residual_sigma], &residual) > 11.0);
        }
    }
}
