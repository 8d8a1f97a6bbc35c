"""The faults of the campaign, the most informative ones first."""

from __future__ import annotations

from functools import partial
from signal import Signals

from campaign.damaged_files import DamagedRecording, FuzzedInput, HostileRecordings
from campaign.environments import UnusualEnvironment
from campaign.fault import Fault
from campaign.restarts import Restarts
from campaign.signals import CommandSignal, HelperSignal, Moment, NodeSignal
from campaign.strangers import Stranger
from campaign.surroundings import BusyMachine, FailingDisk, FullDisk

KILL = (Signals.SIGKILL,)
HANG = (Signals.SIGSTOP,)
STOP = (Signals.SIGINT, Signals.SIGTERM, Signals.SIGHUP)


def _node(name: str, moment: Moment, signals: tuple[Signals, ...], lasts_s: float) -> Fault:
    draw = partial(NodeSignal.draw, moment=moment, signals=signals)
    return Fault(f'{name} {moment.value}', draw, lasts_s)


FAULTS = (
    _node('kill -9 of a node', Moment.MIDDLE, KILL, 12.0),
    Fault('kill -9 of the command', partial(CommandSignal.draw, signals=KILL), 8.0),
    _node('kill -9 of a node', Moment.START, KILL, 10.0),
    Fault('INT, TERM or HUP to the command', partial(CommandSignal.draw, signals=STOP), 8.0),
    Fault('drivers killed and started again', Restarts.draw, 15.0),
    Fault('nonsense on open topics', partial(Stranger.draw, in_the_loop=False), 12.0),
    Fault('a stranger in the loop', partial(Stranger.draw, in_the_loop=True), 12.0),
    Fault('full disk', FullDisk.draw, 10.0, needs_mounts=True),
    Fault('failing disk', FailingDisk.draw, 10.0, needs_mounts=True),
    Fault('unusual environment', UnusualEnvironment.draw, 8.0, needs_mounts=True),
    Fault('signal to a helper process', HelperSignal.draw, 12.0),
    Fault('damaged recording', DamagedRecording.draw, 15.0),
    Fault('hostile recordings', HostileRecordings.draw, 20.0),
    _node('kill -9 of a node', Moment.END, KILL, 10.0),
    _node('SIGSTOP of a node', Moment.MIDDLE, HANG, 14.0),
    _node('INT, TERM or HUP to a node', Moment.MIDDLE, STOP, 12.0),
    Fault('nonsense in scenario and --set', FuzzedInput.draw, 5.0),
    _node('SIGSTOP of a node', Moment.END, HANG, 12.0),
    _node('INT, TERM or HUP to a node', Moment.START, STOP, 10.0),
    _node('INT, TERM or HUP to a node', Moment.END, STOP, 10.0),
    _node('SIGSTOP of a node', Moment.START, HANG, 25.0),
    Fault('busy machine', BusyMachine.draw, 30.0, alone=True),
)
"""In the order in which they are tested."""

BY_NAME = {fault.name: fault for fault in FAULTS}
