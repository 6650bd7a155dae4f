"""What really happens: experiments on the MuJoCo models and the measurement chain; writes campaigns."""
