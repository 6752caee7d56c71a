"""The real recordings: what is expected of each, and the way they go through the program, for tests and benchmarks.

What is expected is from the README of the recordings and the requirements, not from what this program said.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path

from monitor.config.load import Config, load_config
from monitor.config.source import SourceSection
from monitor.health import onset as detect
from monitor.health.channel import detect_input
from monitor.health.later_stages import ChannelBlock
from monitor.health.name.naming import Naming
from monitor.health.output import ChannelOutput
from monitor.health.record import Record
from monitor.health.signal.features import FAULTS
from monitor.health.state import ChannelSettings
from monitor.service.setup import open_configured, source_settings
from reference.steps import Steps
from streams.types.block import Block, Rejected

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
        expected: the name that must be given, or None where none need be.
        kind: what the README says of it.
        label: the part that the source calls damaged where the recording does not bear it out, or where the label is
            disputable: then it may be named, and silence is right too. None: ``expected`` is the part.
        comb_hz: where the README found the comb of the part, or where its nominal frequency stands; None where there
            is none.
    """

    file: str
    config: str
    expected: str | None
    kind: str
    label: str | None = None
    comb_hz: float | None = None

    @property
    def part(self) -> str | None:
        """Return the damaged part, or None where nothing is damaged."""
        return self.label or self.expected

    @property
    def allowed(self) -> frozenset[str | None]:
        """Return the names that are not wrong: ``expected``, and the label alone or joined."""
        label = self.label
        joined = () if label is None else (label, *("|".join(pair) for pair in PAIRS if label in pair))
        return frozenset((self.expected, *joined))

    def judge(self, fault: str | None) -> str:
        """Return right, joined, silent or wrong; of an undamaged bearing quiet, healthy named or disputed."""
        if not self.kind.startswith("disputed"):
            return judge(self.part, fault)
        return "disputed" if fault in self.allowed - {None} else judge(None, fault)


PAIRS = tuple(combinations(FAULTS, 2))


def judge(part: str | None, fault: str | None) -> str:
    """Judge a name: right, joined, silent or wrong; where ``part`` is None (undamaged), quiet or healthy named.

    ``undecided`` is silence. A name of two parts is joined if the damaged one is among them.
    """
    named = None if fault == "undecided" else fault
    if part is None:
        return "quiet" if named is None else "healthy named"
    if named is None:
        return "silent"
    if named == part:
        return "right"
    return "joined" if part in named.split("|") else "wrong"


_BALL, _WEAK = "damaged ball, not findable", "damaged, comb less than 0.3 deep"
CASES = (
    Case("cwru/105_0.mat", "cwru_drive_end", "inner", "damaged", comb_hz=161.7),
    Case("cwru/209_0.mat", "cwru_drive_end", "inner", "damaged", comb_hz=161.8),
    Case("cwru/130@6_0.mat", "cwru_drive_end", "outer", "damaged", comb_hz=107.6),
    Case("cwru/145@3_1.mat", "cwru_drive_end", "outer", "damaged", comb_hz=105.9),
    Case("cwru/296@6_2.mat", "cwru_fan_end", "outer", "damaged", comb_hz=89.7),
    Case("cwru/277_3.mat", "cwru_fan_end", None, _WEAK, "inner", comb_hz=142.3),
    Case("cwru/286_0.mat", "cwru_fan_end", "ball|cage", "damaged ball, comb of the cage", "ball", comb_hz=11.43),
    Case("cwru/118_0.mat", "cwru_drive_end", None, _BALL, "ball", comb_hz=141.2),
    Case("cwru/298@3_0.mat", "cwru_fan_end", None, _WEAK, "outer", comb_hz=91.4),
    Case("cwru/97_Normal_0.mat", "cwru_drive_end", None, "healthy"),
    Case("cwru/97_Normal_0.mat", "cwru_fan_end", None, "healthy"),
    Case("mfpt/InnerRaceFault_vload_1.mat", "mfpt", "inner", "damaged", comb_hz=118.0),
    Case("mfpt/InnerRaceFault_vload_4.mat", "mfpt", "inner", "damaged", comb_hz=118.0),
    Case("mfpt/OuterRaceFault_vload_1.mat", "mfpt", "outer", "damaged", comb_hz=80.4),
    Case("mfpt/OuterRaceFault_vload_5.mat", "mfpt", "outer", "damaged", comb_hz=80.4),
    Case("hit_sm_mfs/Normal_1200.mat", "hit_sm", None, "healthy"),
    Case("hit_sm_mfs/IR5_1200.mat", "hit_sm", "inner", "damaged", comb_hz=108.4),
    Case("hit_sm_mfs/OR8_1200.mat", "hit_sm", "outer", "damaged", comb_hz=71.9),
    Case("uestc/O_1000_2.mat", "uestc", "outer", "damaged", comb_hz=50.9),
    Case("uestc/O_800_2.mat", "uestc", "outer", "damaged", comb_hz=39.9),
    Case("uestc/I_1000_2.mat", "uestc", "inner", "damaged", comb_hz=80.8),
    Case("uestc/I_800_2.mat", "uestc", None, _WEAK, "inner", comb_hz=65.0),
    Case("uestc/B_1000_2.mat", "uestc", None, _BALL, "ball", comb_hz=66.4),
    Case("uestc/B_800_2.mat", "uestc", None, _BALL, "ball", comb_hz=53.1),
    Case("uestc/N_1000_2.mat", "uestc", None, "healthy"),
    Case("uestc/N_800_2.mat", "uestc", None, "healthy"),
    Case("ims_samples/2003.10.22.12.06.24.xz", "ims_test1", None, "healthy"),
    Case("ims_samples/2003.10.22.12.09.13.xz", "ims_test1", None, "healthy"),
    Case("ims_samples/2004.02.12.10.32.39.xz", "ims_test2", None, "healthy"),
    Case("ims_samples/2004.02.12.10.42.39.xz", "ims_test2", None, "healthy"),
    Case("ims_samples/2004.02.19.06.22.39.xz", "ims_test2", None, "machine stopped"),
)

_OTHER = "undamaged bearing at the other end of the motor"
OTHER_ENDS = (
    *(
        Case(f"cwru/{name}.mat", "cwru_fan_end", None, _OTHER)
        for name in ("105_0", "209_0", "130@6_0", "145@3_1", "118_0")
    ),
    *(Case(f"cwru/{name}.mat", "cwru_drive_end", None, _OTHER) for name in ("296@6_2", "277_3", "286_0")),
    Case("cwru/298@3_0.mat", "cwru_drive_end", None, "disputed: called undamaged", "outer", comb_hz=107.7),
)
"""Accelerometers of the undamaged bearing of a motor whose other bearing is damaged."""


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
    found = ChannelBlock(block.samples[0], block.rate, block.sequence, block.elapsed, output.block.verdict)
    return detect_input(output.features, found, absolute=True, usable=output.block.verdict.for_baseline)
