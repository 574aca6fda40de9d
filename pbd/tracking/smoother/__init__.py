"""One estimate of the whole recording: knots, factors, Gauss-Newton, covariance."""
