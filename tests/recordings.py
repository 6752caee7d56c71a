"""The real recordings: what is expected of each, and the way they go through the program, for tests and benchmarks.

What is expected is from the README of the recordings and the requirements, not from what this program said.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from monitor.config.load import Config, load_config
from monitor.config.source import SourceSection
from monitor.health import detect
from monitor.health.channel import ChannelBlock, detect_input
from monitor.health.naming import Naming
from monitor.health.output import ChannelOutput
from monitor.health.record import Record
from monitor.health.state import ChannelSettings
from monitor.service.setup import open_configured, source_settings
from streams.block import Block, Rejected
from tests.steps import Steps

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


@dataclass(frozen=True)
class Run:
    """A run to failure.

    Attributes:
        name: of the bearing.
        file: under the folder of recordings.
        config: name of the example configuration.
        window: first and last block at which the final stage may be said to begin.
        known_by: block by which it must be known.
    """

    name: str
    file: str
    config: str
    window: tuple[int, int]
    known_by: int

    def verdict(self, marks: Mapping[str, tuple[int, int] | None]) -> str:
        """Judge onset and known block of each channel: right, early, late, or none.

        Right is: at least one channel inside the window and known in time, and none earlier.
        """
        found = [mark for mark in marks.values() if mark is not None]
        if not found:
            return "none"
        if min(onset for onset, _ in found) < self.window[0]:
            return "early"
        good = any(onset <= self.window[1] and known <= self.known_by for onset, known in found)
        return "right" if good else "late"


RUNS = (
    Run("Bearing2_4", "femto/Bearing2_4.tar.bz2", "pronostia_1650rpm_4200n", (729, 748), 750),
    Run("Bearing3_1", "femto/Bearing3_1.tar.xz", "pronostia_1500rpm_5000n", (486, 497), 505),
    Run("Bearing2_7", "femto/Bearing2_7.tar.xz", "pronostia_1650rpm_4200n", (211, 227), 229),
    Run("Bearing1_1", "femto/Bearing1_1.tar.bz2", "pronostia_1800rpm_4000n", (1130, 2000), 2000),
)


@dataclass(frozen=True)
class Case:
    """A recording to be named.

    Attributes:
        file: under the folder of recordings.
        config: name of the example configuration.
        expected: the part that must be named, or None where none may be.
        kind: what the README says of it.
    """

    file: str
    config: str
    expected: str | None
    kind: str


CASES = (
    Case("cwru/105_0.mat", "cwru_drive_end", "inner", "damaged"),
    Case("cwru/209_0.mat", "cwru_drive_end", "inner", "damaged"),
    Case("cwru/130@6_0.mat", "cwru_drive_end", "outer", "damaged"),
    Case("cwru/118_0.mat", "cwru_drive_end", None, "damaged ball, not findable"),
    Case("cwru/97_Normal_0.mat", "cwru_drive_end", None, "healthy"),
    Case("cwru/97_Normal_0.mat", "cwru_fan_end", None, "healthy"),
    Case("mfpt/InnerRaceFault_vload_1.mat", "mfpt", "inner", "damaged"),
    Case("mfpt/InnerRaceFault_vload_4.mat", "mfpt", "inner", "damaged"),
    Case("mfpt/OuterRaceFault_vload_1.mat", "mfpt", "outer", "damaged"),
    Case("mfpt/OuterRaceFault_vload_5.mat", "mfpt", "outer", "damaged"),
    Case("hit_sm_mfs/Normal_1200.mat", "hit_sm", None, "healthy"),
    Case("hit_sm_mfs/IR5_1200.mat", "hit_sm", "inner", "damaged"),
    Case("hit_sm_mfs/OR8_1200.mat", "hit_sm", "outer", "damaged"),
    Case("ims_samples/2003.10.22.12.06.24.xz", "ims_test1", None, "healthy"),
    Case("ims_samples/2003.10.22.12.09.13.xz", "ims_test1", None, "healthy"),
    Case("ims_samples/2004.02.12.10.32.39.xz", "ims_test2", None, "healthy"),
    Case("ims_samples/2004.02.12.10.42.39.xz", "ims_test2", None, "healthy"),
    Case("ims_samples/2004.02.19.06.22.39.xz", "ims_test2", None, "machine stopped"),
)


@dataclass
class History:
    """What a channel said over a run.

    Attributes:
        inputs: what the detector took from each block.
        namings: block number, verdict of the naming.
        detector: the detector's last state.
        fault: what the fault is called in the end, or None.
    """

    inputs: list[detect.DetectInput] = field(default_factory=list)
    namings: list[tuple[int, Naming]] = field(default_factory=list)
    detector: detect.DetectState = field(default_factory=detect.DetectState)
    fault: str | None = None


def example(name: str, block_s: float | None = None) -> tuple[Config, SourceSection]:
    """Return an example configuration and its source, with another length of block where one is given."""
    config = load_config(EXAMPLES / f"{name}.toml")
    section = config.source[0]
    return config, section if block_s is None else section.model_copy(update={"block_s": block_s})


def watch(
    config_name: str,
    path: Path,
    *,
    speed_error: float = 0.0,
    block_s: float | None = None,
    channels: Mapping[str, ChannelSettings] | None = None,
) -> Iterator[tuple[Block | Rejected, Steps, Record]]:
    """Take a recording through the program as an example configuration says, without a store.

    Args:
        config_name: of the example.
        path: of the recording.
        speed_error: share by which the stated speed is made wrong.
        block_s: seconds to a block in place of the configured.
        channels: in place of the configured ones.
    """
    config, section = example(config_name, block_s)
    settings = source_settings(config, section)
    if channels is not None:
        settings = replace(settings, channels=channels)
    steps = Steps(settings)
    for item in open_configured(config, section, str(path)):
        block = item
        if isinstance(item, Block) and speed_error:
            stated = item.speed if item.speed is not None else next(iter(settings.channels.values())).condition.speed
            assert stated is not None
            block = replace(item, speed=stated * (1.0 + speed_error))
        yield block, steps, steps.take(block)


def histories(run: Run, folder: Path) -> dict[str, History]:
    """Take a run to failure through the program and return what each channel said."""
    found: dict[str, History] = {}
    last: Steps | None = None
    for item, steps, _ in watch(run.config, folder / run.file):
        last = steps
        if not isinstance(item, Block):
            raise AssertionError(f"{run.name}: {item}")
        for name, output in steps.outputs.items():
            history = found.setdefault(name, History())
            history.inputs.append(_detector_input(item, output))
            if output.naming is not None:
                history.namings.append((item.sequence, output.naming))
    for name, history in found.items():
        assert last is not None
        state = last.state.channels[name]
        history.detector = state.detect
        history.fault = None if state.named is None else state.named.fault
    return found


def _detector_input(block: Block, output: ChannelOutput) -> detect.DetectInput:
    assert output.features is not None
    found = ChannelBlock(block.samples[0], block.rate, block.sequence, block.elapsed, output.verdict)
    return detect_input(output.features, found, absolute=True, usable=output.verdict.for_baseline)
