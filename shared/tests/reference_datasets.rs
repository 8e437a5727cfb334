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

/// Rows of powers of x from `from` on, and y, of a file with y and x.
fn powers<const N: usize, const W: usize>(table: &str, from: i32) -> Vec<[f64; W]> {
    assert_eq!(W, N + 1);
    let lines = table.lines().filter(|line| !line.starts_with(['#', 'y']));
    let row = |line: &str| {
        let (y, x) = line.split_once(',').unwrap();
        let x: f64 = x.parse().unwrap();
        let mut row = [0.0; W];
        (from..)
            .zip(&mut row[..N])
            .for_each(|(k, cell)| *cell = x.powi(k));
        row[N] = y.parse().unwrap();
        row
    };
    lines.map(row).collect()
}

/// Correct digits of the coefficients, of their standard deviations and of the residual one are at least these.
fn certified<const N: usize>(
    found: &Fit<N>,
    coefficients: [f64; N],
    sigma: [f64; N],
    residual_sigma: f64,
    least: [f64; 3],
) {
    let correct = [
        digits(&found.coefficients, &coefficients),
        digits(&found.sigma, &sigma),
        digits(&[found.residual_sigma], &[residual_sigma]),
    ];
    println!("{correct:.1?} digits");
    assert!(
        correct.iter().zip(least).all(|(c, l)| *c >= l),
        "{correct:?} digits, {least:?} expected"
    );
}

#[test]
fn a_straight_line_and_a_parabola_of_calibrations_are_certified() {
    let norris = powers::<2, 3>(include_str!("nist/norris.csv"), 0);
    assert_eq!(norris.len(), 36);
    certified(
        &fit(&norris),
        [-0.262323073774029, 1.00211681802045],
        [0.232818234301152, 0.429796848199937e-3],
        0.884796396144373,
        [11.5, 13.0, 13.0],
    );
    // Loads of millions, squared: a condition number of 1e13 where columns are not scaled.
    let pontius = powers::<3, 4>(include_str!("nist/pontius.csv"), 0);
    assert_eq!(pontius.len(), 40);
    certified(
        &fit(&pontius),
        [
            0.673565789473684e-3,
            0.732059160401003e-6,
            -0.316081871345029e-14,
        ],
        [
            0.107938612033077e-3,
            0.157817399981659e-9,
            0.486652849992036e-16,
        ],
        0.205177424076185e-3,
        [11.0, 12.0, 12.0],
    );
}

#[test]
fn lines_through_the_origin_are_certified() {
    let noint1: [[f64; 2]; 11] = std::array::from_fn(|n| [60.0 + n as f64, 130.0 + n as f64]);
    certified(
        &fit(&noint1),
        [2.07438016528926],
        [0.165289256198347e-1],
        3.56753034006338,
        [14.0, 13.0, 13.0],
    );
    certified(
        &fit(&[[4.0, 3.0], [5.0, 4.0], [6.0, 4.0]].map(|[x, y]| [x, y])),
        [0.727272727272727],
        [0.420827318078432e-1],
        0.369274472937998,
        [14.0, 13.0, 13.0],
    );
}

/// The condition number is 1.8e15: a Householder factorisation of the same columns has 7.6 digits at the best.
#[test]
fn a_polynomial_of_the_tenth_degree_is_certified_to_seven_digits() {
    let filip = powers::<11, 12>(include_str!("nist/filip.csv"), 0);
    assert_eq!(filip.len(), 82);
    certified(
        &fit(&filip),
        [
            -1467.48961422980,
            -2772.17959193342,
            -2316.37108160893,
            -1127.97394098372,
            -354.478233703349,
            -75.1242017393757,
            -10.8753180355343,
            -1.06221498588947,
            -0.670191154593408e-1,
            -0.246781078275479e-2,
            -0.402962525080404e-4,
        ],
        [
            298.084530995537,
            559.779865474950,
            466.477572127796,
            227.204274477751,
            71.6478660875927,
            15.2897178747400,
            2.23691159816033,
            0.221624321934227,
            0.142363763154724e-1,
            0.535617408889821e-3,
            0.896632837373868e-5,
        ],
        0.334801051324544e-2,
        [7.0, 7.0, 7.0],
    );
}
