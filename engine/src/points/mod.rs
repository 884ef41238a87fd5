//! Points: sweeps in the clip frame, their colours and their spacing.
