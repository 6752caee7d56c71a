"""Make the libraries that ship for the demo: of simulated lives at its load and speed, and of quadratic growth alone.

Run as ``python -m benchmarks.forecast.demo_libraries``. The same machine makes the same bits again where the kernels
were compiled before; another one agrees to rounding.
"""

from __future__ import annotations

import sys

from models.work.choose import local_runner
from monitor.commands import demo, demo_prior
from monitor.commands.common import counter
from monitor.records.library_file import save_library
from monitor.service.libraries import build_library


def main() -> None:
    """Make both libraries, and write them where they ship."""
    config = demo.demo_config()
    with local_runner(0) as runner:
        lives = build_library(
            demo.demo_population(config),
            runs=demo.LIVES,
            thresholds=config.forecast.thresholds,
            runner=runner,
            progress=counter("lives", quiet=False),
        )
    quadratic = demo_prior.build_quadratic()
    for library, path in ((lives, demo.SHIPPED), (quadratic, demo_prior.SHIPPED)):
        save_library(library, path)
        sys.stderr.write(f"{path}: {path.stat().st_size} bytes, hash {library.hash}\n")


if __name__ == "__main__":
    main()
