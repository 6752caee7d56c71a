"""The simulated lives of ``forecast.methods``: fixed before anything was fitted to them, and not to be
tuned.

TEST is what methods are scored on; no fitting and no tuning may see it. LIBRARY is what forecasters are fitted on; what
is chosen (features, widths, columns) is chosen by out-of-fold figures on it. The two have different seeds, and TEST has
floors, rig parameters, slip and missing blocks of its own: its floors are rougher on the whole, and all rig parameters
of its lives are off, also the masses and the shaft stiffness that neither library nor map varies.

What both share is the population prior that every answer leans on: growth laws, durations, depths, loads and speeds.
The amplitude that a sensor picks up beside the bearing at the lines of BPFO is drawn for each life, 2 to 20 mg.
"""

from __future__ import annotations

from models.lives.population import Population
from streams.types.block import STANDARD_GRAVITY

THRESHOLD = 0.05e-6
"""V_eq to forecast, m2."""
FRACTIONS = (0.25, 0.5, 0.75)
"""Moments at which forecasts are scored, as shares of the time from the onset to the threshold."""
TEST_RUNS = 600
LIBRARY_RUNS = 1000

FIVE_LAWS = ("quadratic", "exponential", "power", "linear_then_fast", "stall_then_jump")
"""Laws of the test lives, and of the library that was first scored on them."""
LIBRARY = Population(slip=(0.0, 0.01), seed=1850)
TEST = Population(
    laws=tuple((law, 1.0) for law in FIVE_LAWS),
    durations=(150.0 * 60.0, 900.0 * 60.0),
    v_0=(0.0008e-6, 0.006e-6),
    scatter=(0.02, 0.02),
    line_scatter=(0.02, 0.02),
    load_error=0.0,
    speed_error=0.0,
    speed_jitter=0.0,
    load_steps=0.0,
    gain_drift=0.0,
    background_rms=(0.04 * STANDARD_GRAVITY, 0.06 * STANDARD_GRAVITY),
    background_harmonic=(0.002 * STANDARD_GRAVITY, 0.02 * STANDARD_GRAVITY),
    rig_spread=(
        ("m_i", 0.03),
        ("m_o", 0.03),
        ("m_r", 0.03),
        ("k_i", 0.03),
        ("k_c", 0.03),
        ("c_i", 0.05),
        ("c_r", 0.05),
        ("alpha_c", 0.05),
        ("beta_c", 0.05),
        ("k_r", 0.02),
    ),
    floor_sd=(0.5e-6, 1.5e-6),
    slip=(0.001, 0.008),
    missing=0.05,
    seed=60020,
)
