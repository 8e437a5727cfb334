//! Files of other makers, one module a format. What they hold becomes a campaign, or rows that
//! [`measure`](crate::measure) makes segments of.

pub mod delimited;
