//! Table 1, coefficients of three types of instrument, and Table 2, their vibration errors in white noise of 1 g rms,
//! computed by the paper and measured on a shaker. The tables carry no uncertainties.

use shared::model::Coefficients;

/// A type of instrument in the paper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Published {
    /// Name of the type.
    pub instrument: &'static str,
    /// Table 1; the scale factor is not published and stands as 1 V/g.
    pub coefficients: Coefficients<f64>,
    /// Table 2, vibration error computed by the paper, g.
    pub computed_vre_g: f64,
    /// Table 2, vibration error measured on the shaker, g.
    pub measured_vre_g: f64,
}

/// A row of Table 1 as printed: k0, k1', k2, k3, k4, d_PA, d_OA in 1e-4, k_IO in 1e-5, k_IP in 1e-6, k_PO in 1e-7;
/// and of Table 2 in 1e-4 g.
const fn published(instrument: &'static str, t1: [f64; 10], t2: [f64; 2]) -> Published {
    Published {
        instrument,
        coefficients: Coefficients {
            scale_factor_v_per_g: 1.0,
            bias_g: t1[0] * 1e-4,
            asymmetry: t1[1] * 1e-4,
            second_order_per_g: t1[2] * 1e-4,
            third_order_per_g2: t1[3] * 1e-4,
            fourth_order_per_g3: t1[4] * 1e-4,
            misalignment_oa_rad: t1[6] * 1e-4,
            misalignment_pa_rad: t1[5] * 1e-4,
            cross_ip_per_g: t1[8] * 1e-6,
            cross_io_per_g: t1[7] * 1e-5,
            cross_po_per_g: t1[9] * 1e-7,
            fifth_order_per_g4: 0.0,
            bias_asymmetry_g: 0.0,
            odd_quadratic_per_g: 0.0,
            cross_pp_per_g: 0.0,
            cross_oo_per_g: 0.0,
        },
        computed_vre_g: t2[0] * 1e-4,
        measured_vre_g: t2[1] * 1e-4,
    }
}

/// Tables 1 and 2.
pub const TABLES: [Published; 3] = [
    published(
        "AKS-05",
        [
            -0.07, 3.015, -2.56, -1.20, -1.20, 3.90, 3.05, 1.1, 1.1, 0.001,
        ],
        [1.8, 2.8],
    ),
    published(
        "A-15",
        [
            0.12, -6.850, 0.50, 1.12, 1.12, 9.01, -5.02, -1.0, -1.0, -0.002,
        ],
        [-8.0, -6.7],
    ),
    published(
        "AL-1",
        [-2.25, -8.132, 4.2, -8.0, -8.0, 1.80, 0.80, 5.5, 5.5, 550.0],
        [15.5, 21.0],
    ),
];
