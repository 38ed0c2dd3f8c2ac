"""The density of a range that is right, or wrong and then uniform up to the longest there is.

A range is Gaussian about the distance with the probability 1 - `wrong`. `squared` is its squared
error over its variance, [1]; lengths are in m, densities in 1/m. All but the loss take arrays too.

Source: the two-component likelihood of a range finder, Thrun, Burgard, Fox, Probabilistic
Robotics, section 6.3.
"""

import math

import numpy as np

from sngr_utils.numerics.jit import also_compile_once, compile_once

OUTLIER_SHARE = 0.5  # knowing nothing about a range: right or wrong alike
TWO_PI = 2 * math.pi


@also_compile_once
def peak(variance, wrong):
    """The density of a right range at the distance itself."""
    return (1 - wrong) / np.sqrt(TWO_PI * variance)


@also_compile_once
def density(squared, variance, wrong, longest):
    """The density of a range, whichever it is."""
    return peak(variance, wrong) * np.exp(-0.5 * squared) + wrong / longest


@also_compile_once
def floor(variance, wrong, longest):
    """The density of a wrong range over the highest of a right one."""
    return wrong / longest / peak(variance, wrong)


@compile_once
def loss(squared, wrong_floor):
    """Minus the log of the density over its largest value, [nats]; of a `floor`."""
    return math.log1p(wrong_floor) - math.log(math.exp(-0.5 * squared) + wrong_floor)
