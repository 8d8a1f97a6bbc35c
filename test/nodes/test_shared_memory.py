"""Leftovers of killed processes in shared memory are removed; files in use stay."""

import ctypes
import json
import mmap
import os
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from graph import (
    BALLBOT,
    LAST_RESORT_S,
    environment,
    private_shared_memory,
    without_taken_ports,
)
from ports import needs_layout_of_ports

from ballbot_ros.errors import BallbotError
from ballbot_ros.nodes import middleware, shared_memory
from ballbot_ros.nodes.port_readers import (
    AFTER_READERS,
    READER_SIZE,
    READERS,
    find_idle_readers,
)
from ballbot_ros.nodes.processes import END_WITH_PARENT
from ballbot_ros.nodes.shared_memory import (
    INITIALISED,
    MIN_PORT_BYTES,
    clear_shared_memory,
    find_broken_ports,
    find_leftovers,
    mark_dead_readers,
    sweep,
)

PORT, SEGMENT = 'fastrtps_port7004', 'fastrtps_0123456789abcdef'
MUTEX = f'sem.{PORT}_mutex'
WHOLE_PORT = INITIALISED.ljust(MIN_PORT_BYTES, b'\0')
BROKEN_PORTS = {
    'empty': b'',
    'not initialised': bytes(MIN_PORT_BYTES),
    'being initialised': b'\1'.ljust(MIN_PORT_BYTES, b'\0'),
    'truncated': INITIALISED,
}
HOLD = {
    'lock': 'file = open(path); fcntl.flock(file, fcntl.LOCK_EX)',
    'shared lock': 'file = open(path); fcntl.flock(file, fcntl.LOCK_SH)',
    'mapping': 'file = open(path, "r+b"); memory = mmap.mmap(file.fileno(), 0)',
}


OLD_S, YOUNG_S = 3600.0, -3600.0


def make(folder, name, content=b'', age_s=OLD_S):
    path = folder / name
    path.write_bytes(content)
    set_age(path, age_s)
    return path


def set_age(path, age_s):
    made = time.time() - age_s
    os.utime(path, (made, made))


def make_mutex(folder):
    path = make(folder, MUTEX, bytes(32))
    with path.open('r+b') as file, mmap.mmap(file.fileno(), 0) as memory:
        semaphore = ctypes.c_char.from_buffer(memory)
        assert ctypes.CDLL(None).sem_init(ctypes.byref(semaphore), 1, 1) == 0
        del semaphore
    set_age(path, OLD_S)
    return path


def acquire(mutex):
    with mutex.open('r+b', buffering=0) as file:
        return shared_memory._semaphore('sem_trywait', file)


def make_port(folder):
    """Create a port with all its files."""
    make(folder, PORT, WHOLE_PORT)
    make(folder, f'{PORT}_el')
    make(folder, f'{PORT}_sl')
    make_mutex(folder)


def names(folder):
    return sorted(path.name for path in folder.iterdir())


@contextmanager
def held(path, how):
    """Let another process hold a file."""
    script = (
        f'import fcntl, mmap, sys; path = {str(path)!r}; {HOLD[how]}; print(); sys.stdin.read()'
    )
    with subprocess.Popen(
        [sys.executable, '-c', script], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as holder:
        holder.stdout.readline()
        yield
        holder.kill()


def test_unused_files_are_removed(tmp_path):
    make_port(tmp_path)
    make(tmp_path, SEGMENT, bytes(1000))
    make(tmp_path, f'{SEGMENT}_el')
    expected = {tmp_path / name: (tmp_path / name).stat().st_size for name in names(tmp_path)}
    assert dict(find_leftovers(tmp_path)) == expected
    assert names(tmp_path) == sorted(path.name for path in expected)
    assert dict(sweep(tmp_path, older_than_s=0)) == expected
    assert names(tmp_path) == []


def test_files_of_other_programs_stay(tmp_path):
    for name in ('sem.other', 'fastrtps_port', 'fastrtps_port7x', f'{SEGMENT}0', f'my_{PORT}'):
        make(tmp_path, name)
    (tmp_path / PORT).mkdir()
    (tmp_path / SEGMENT).symlink_to(tmp_path / 'sem.other')
    before = names(tmp_path)
    assert sweep(tmp_path, older_than_s=0) == []
    assert names(tmp_path) == before


@pytest.mark.parametrize(
    ('name', 'how'),
    [
        (f'{PORT}_el', 'lock'),
        (f'{PORT}_sl', 'shared lock'),
        (PORT, 'mapping'),
        (MUTEX, 'mapping'),
        (f'{SEGMENT}_el', 'lock'),
        (SEGMENT, 'mapping'),
    ],
)
def test_a_resource_in_use_stays_with_all_its_files(tmp_path, name, how):
    make_port(tmp_path)
    make(tmp_path, SEGMENT, bytes(1000))
    make(tmp_path, f'{SEGMENT}_el')
    before = names(tmp_path)
    of_port = PORT in name
    with held(tmp_path / name, how):
        sweep(tmp_path, older_than_s=0)
        assert names(tmp_path) == [n for n in before if (PORT in n) == of_port]
    sweep(tmp_path, older_than_s=0)
    assert names(tmp_path) == []


@pytest.mark.parametrize(
    ('name', 'how', 'look'),
    [(f'{PORT}_el', 'lock', '_unlocked'), (PORT, 'mapping', '_unmapped')],
)
def test_a_file_taken_by_a_process_after_the_first_look_stays(
    tmp_path, monkeypatch, name, how, look
):
    make_port(tmp_path)
    second_look = getattr(shared_memory, look)

    def first_look(resources):
        monkeypatch.setattr(shared_memory, look, second_look)
        return list(resources)

    monkeypatch.setattr(shared_memory, look, first_look)
    with held(tmp_path / name, how):
        assert sweep(tmp_path) == []


def test_a_process_that_opens_a_port_after_the_first_look_finds_its_lock_free(
    tmp_path, monkeypatch
):
    make_port(tmp_path)
    assert acquire(tmp_path / MUTEX)
    second_look, lock = shared_memory._unmapped, shared_memory.fcntl.flock
    locked = []

    def first_look(resources):
        monkeypatch.setattr(shared_memory, '_unmapped', second_look)
        return list(resources)

    def note_and_lock(file, operation):
        locked.append(getattr(file, 'name', ''))
        lock(file, operation)

    monkeypatch.setattr(shared_memory, '_unmapped', first_look)
    monkeypatch.setattr(shared_memory.fcntl, 'flock', note_and_lock)
    with held(tmp_path / MUTEX, 'mapping'):
        assert sweep(tmp_path, older_than_s=0) == []
    assert locked == ['']  # the lock of the folder, against another sweep


@pytest.mark.parametrize(('name', 'how'), [(f'{PORT}_el', 'lock'), (PORT, 'mapping')])
def test_a_sweep_locks_no_resource_in_use(tmp_path, monkeypatch, name, how):
    make_port(tmp_path)
    claimed = []
    monkeypatch.setattr(shared_memory._Resource, 'claim', lambda *arguments: claimed.append(1))
    with held(tmp_path / name, how):
        sweep(tmp_path)
        assert not claimed
    sweep(tmp_path)
    assert claimed


def test_a_port_whose_creator_died_with_the_semaphore_is_removed(tmp_path):
    make_port(tmp_path)
    assert acquire(tmp_path / MUTEX)
    sweep(tmp_path, older_than_s=0)
    assert names(tmp_path) == []


def test_a_resource_with_a_young_file_stays(tmp_path):
    make_port(tmp_path)
    make(tmp_path, f'{PORT}_el', age_s=YOUNG_S)
    assert sweep(tmp_path) == []
    set_age(tmp_path / f'{PORT}_el', OLD_S)
    assert sweep(tmp_path)


def test_another_users_files_stay(tmp_path, monkeypatch):
    make_port(tmp_path)
    monkeypatch.setattr(shared_memory.os, 'geteuid', lambda: os.getuid() + 1)
    assert sweep(tmp_path) == []


def test_a_missing_folder_has_no_leftovers(tmp_path):
    assert clear_shared_memory(tmp_path / 'missing') == []


def test_a_file_that_vanishes_meanwhile_is_not_counted(tmp_path, monkeypatch):
    make_port(tmp_path)
    search = shared_memory._unmapped

    def search_and_lose_one(resources):
        (tmp_path / PORT).unlink(missing_ok=True)
        return search(resources)

    monkeypatch.setattr(shared_memory, '_unmapped', search_and_lose_one)
    assert PORT not in [leftover.path.name for leftover in sweep(tmp_path)]


def test_a_port_that_is_recreated_meanwhile_stays(tmp_path, monkeypatch):
    make_port(tmp_path)
    operate = shared_memory._semaphore

    def make_again(operation, file):
        new = make(tmp_path, 'new', WHOLE_PORT)
        new.rename(tmp_path / PORT)
        return operate(operation, file)

    monkeypatch.setattr(shared_memory, '_semaphore', make_again)
    assert sweep(tmp_path) == []


def test_a_port_can_not_be_opened_while_it_is_judged(tmp_path):
    make_port(tmp_path)
    with shared_memory._dead_resources(tmp_path, 0):
        assert not acquire(tmp_path / MUTEX)
    assert acquire(tmp_path / MUTEX)


def test_a_process_waiting_for_a_removed_port_is_not_let_in(tmp_path):
    make_port(tmp_path)
    with (tmp_path / MUTEX).open('r+b', buffering=0) as waiting:
        assert sweep(tmp_path)
        assert not shared_memory._semaphore('sem_trywait', waiting)


@pytest.mark.parametrize('content', [WHOLE_PORT, b''], ids=['dead', 'broken'])
def test_of_two_simultaneous_sweeps_one_does_the_work(tmp_path, monkeypatch, content):
    port = make(tmp_path, PORT, content)
    if not content:  # pretend that a process has mapped the broken port, and waits for it
        monkeypatch.setattr(shared_memory, '_unmapped', lambda resources: [])
    with shared_memory._only_sweep(tmp_path):
        assert sweep(tmp_path) == []
    assert sweep(tmp_path) == [(port, len(content))]


@pytest.mark.parametrize('content', BROKEN_PORTS.values(), ids=BROKEN_PORTS)
def test_a_broken_port_is_found_and_is_removed_once_it_is_old(tmp_path, content):
    port = make(tmp_path, PORT, content, age_s=YOUNG_S)
    make_mutex(tmp_path)
    make(tmp_path, f'{PORT}1', WHOLE_PORT, age_s=YOUNG_S)
    make(tmp_path, SEGMENT, age_s=YOUNG_S)
    assert find_broken_ports(tmp_path) == [port]
    with held(tmp_path / MUTEX, 'mapping'):  # by its creator, or by a process that waits for it
        assert sweep(tmp_path) == []
        set_age(port, OLD_S)
        sweep(tmp_path)
        assert not port.exists()


def test_a_young_broken_port_is_given_time(tmp_path, monkeypatch):
    make(tmp_path, PORT, age_s=YOUNG_S)
    monkeypatch.setattr(
        shared_memory.time, 'sleep', lambda s: make(tmp_path, PORT, WHOLE_PORT, age_s=YOUNG_S)
    )
    assert clear_shared_memory(tmp_path) == []
    assert names(tmp_path) == [PORT]


def test_a_permanently_broken_port_is_removed(tmp_path, monkeypatch):
    port = make(tmp_path, PORT, age_s=YOUNG_S)
    monkeypatch.setattr(shared_memory.time, 'sleep', lambda s: set_age(port, OLD_S))
    assert clear_shared_memory(tmp_path) == [(port, 0)]


OPENS_A_PORT = """
import rclpy
rclpy.init()
rclpy.create_node('waits')
print('goes on')
"""
SWEEPS = """
from pathlib import Path
import sys, time
from ballbot_ros.nodes.shared_memory import sweep
maps = Path(f'/proc/{sys.argv[1]}/maps')
while 'fastrtps_port7000' not in maps.read_text():
    time.sleep(0.01)
assert sweep()
"""


@pytest.mark.graph
def test_a_process_waiting_for_a_broken_port_continues_when_the_port_is_removed(domain):
    """A process begins to wait if the port is not yet old enough to be recognised as broken."""
    pytest.importorskip('rclpy')
    script = """
    truncate -s 100000 /dev/shm/fastrtps_port7000
    touch -d @0 /dev/shm/fastrtps_port7000
    "$1" -c "$2" &
    "$1" -c "$3" $! && wait $!
    """
    done = subprocess.run(
        [*private_shared_memory(), 'sh', '-c', script, 'sh', sys.executable, OPENS_A_PORT, SWEEPS],
        capture_output=True, text=True, env=environment(domain), timeout=LAST_RESORT_S, check=False,
    )  # fmt: skip
    assert done.stdout == 'goes on\n', done.stderr
    assert done.returncode == 0


def test_a_broken_port_that_can_not_be_removed_is_one_line(tmp_path, monkeypatch):
    port = make(tmp_path, PORT)

    def refuse(path):
        raise PermissionError

    monkeypatch.setattr(Path, 'unlink', refuse)
    monkeypatch.setattr(shared_memory, 'SETTLED_S', 0.0)
    with pytest.raises(
        BallbotError, match=rf'^{port}, left .* every node .* `rm {port}` as its owner or as root$'
    ):
        clear_shared_memory(tmp_path)


def test_starting_ros_clears_leftovers_first_unless_the_command_has_done_it(monkeypatch):
    cleared = []
    monkeypatch.setattr(middleware, 'clear_shared_memory', lambda: cleared.append(True))
    middleware.prepare_middleware()
    assert cleared == [True]
    monkeypatch.setenv(END_WITH_PARENT, '1')
    middleware.prepare_middleware()
    assert cleared == [True]


def make_read_port(folder, *states, end=AFTER_READERS):
    port = make(folder, PORT, WHOLE_PORT[:400].ljust(400 + READERS * READER_SIZE, b'\0') + end)
    with port.open('r+b') as file:
        for reader, state in enumerate(states):
            file.seek(400 + reader * READER_SIZE)
            file.write(bytes([state]))
    make(folder, f'{PORT}_el')
    make_mutex(folder)
    return port


def reader_states(port, count):
    return list(port.read_bytes()[400 : 400 + count * READER_SIZE : READER_SIZE])


IDLE, WAITS, TAKES = 0b001, 0b011, 0b101


def test_readers_of_a_port_without_a_living_reader_are_marked_as_waiting(tmp_path):
    port = make_read_port(tmp_path, TAKES, 0, IDLE, WAITS)
    before = port.read_bytes()
    mark_dead_readers(tmp_path)
    assert reader_states(port, 4) == [WAITS, 0, WAITS, WAITS]
    after = port.read_bytes()
    assert [i for i in range(len(before)) if before[i] != after[i]] == [400, 400 + 2 * READER_SIZE]
    assert acquire(tmp_path / MUTEX)


def test_every_reader_of_a_port_is_found_but_none_in_an_unknown_layout(tmp_path):
    last = READERS - 1
    port = make_read_port(tmp_path, *[0] * last, IDLE)
    assert find_idle_readers(port) == [400 + last * READER_SIZE]
    for content in (b'', WHOLE_PORT):
        port.write_bytes(content)
        assert find_idle_readers(port) == []
    port.unlink()
    assert find_idle_readers(port) == []


@pytest.mark.parametrize('state', [IDLE, TAKES])
def test_a_port_whose_reader_was_killed_between_two_messages_is_removed_at_once(tmp_path, state):
    make_read_port(tmp_path, state)
    set_age(tmp_path / PORT, OLD_S)
    assert {left.path.name for left in sweep(tmp_path)} == {PORT, f'{PORT}_el', MUTEX}


@pytest.mark.parametrize('how', ['lock', 'shared lock'])
def test_a_living_reader_is_left_alone(tmp_path, how):
    port = make_read_port(tmp_path, TAKES, IDLE)
    with held(tmp_path / f'{PORT}_el', how):
        mark_dead_readers(tmp_path)
        assert reader_states(port, 2) == [TAKES, IDLE]
    sweep(tmp_path, older_than_s=2 * OLD_S)
    assert reader_states(port, 2) == [WAITS, WAITS]


def test_a_port_that_is_being_opened_is_left_alone(tmp_path):
    port = make_read_port(tmp_path, TAKES)
    assert acquire(tmp_path / MUTEX)
    mark_dead_readers(tmp_path)
    assert reader_states(port, 1) == [TAKES]
    (tmp_path / MUTEX).unlink()
    mark_dead_readers(tmp_path)
    assert reader_states(port, 1) == [TAKES]


def test_a_port_with_another_layout_is_left_alone(tmp_path):
    port = make_read_port(tmp_path, TAKES, end=b'other')
    mark_dead_readers(tmp_path)
    assert reader_states(port, 1) == [TAKES]


ENDS_AT_A_CHECK = """
import rclpy
from ballbot_ros.nodes import base
from ballbot_ros.nodes.registry import make_node
from ballbot_ros.parameters import GyroParameters
rclpy.init()
node = make_node(GyroParameters())
base.mark_dead_readers = node.finish
base.spin([node], node.done)
"""


@pytest.mark.graph
def test_a_running_node_checks_for_dead_readers(domain):
    pytest.importorskip('rclpy')
    command = [sys.executable, '-c', ENDS_AT_A_CHECK]
    subprocess.run(command, env=environment(domain), timeout=LAST_RESORT_S, check=True)


@pytest.mark.graph
@needs_layout_of_ports
def test_a_publisher_continues_after_its_reader_is_killed_while_taking_a_message(domain):
    """Fast DDS 2.14 waits forever unless the killed reader is marked."""
    pytest.importorskip('rclpy')
    program = Path(__file__).with_name('killed_reader.py')
    done = subprocess.run(
        [*private_shared_memory(), sys.executable, program],
        env=environment(domain) | {'PYTHONPATH': os.pathsep.join(sys.path)},
        capture_output=True, text=True, timeout=LAST_RESORT_S, check=False,
    )  # fmt: skip
    assert done.stdout == 'waits\ngoes on\n', done.stderr


def run_privately(domain, *command, broken_ports=()):
    """Return the result of a run with private shared memory."""
    run = [*command, 'run', 'stationary', '--no-record', '--json']
    done = subprocess.run(
        [*private_shared_memory(*broken_ports), *run],
        capture_output=True, text=True, check=False, env=environment(domain),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.graph
def test_a_run_is_not_held_up_by_broken_ports(domain):
    assert run_privately(domain, *BALLBOT, broken_ports=(7000, 7004))['outcome'] == 'passed'


# Sweep only files older than half a second: a process may have created a file, but not mapped it
# yet.
SWEPT = """
import os, pathlib, subprocess, sys
from ballbot_ros.nodes.shared_memory import SHARED_MEMORY, sweep

def mapped_inodes():
    for maps in pathlib.Path('/proc').glob('[0-9]*/maps'):
        try:
            for line in maps.read_text().splitlines():
                if '/dev/shm/fastrtps_' in line:
                    yield int(line.split()[4])
        except OSError:
            pass

run = subprocess.Popen(sys.argv[1:])
most = 0
while run.poll() is None:
    before = {pathlib.Path(entry): entry.inode() for entry in os.scandir(SHARED_MEMORY)}
    most = max(most, len(before))
    if removed := sweep(older_than_s=0.5):
        lost = {before.get(leftover.path) for leftover in removed} & set(mapped_inodes())
        assert not lost, (removed, lost)
assert most > 40, most
sys.exit(run.returncode)
"""


@pytest.mark.graph
def test_a_running_graph_keeps_its_files_under_repeated_sweeps(domain):
    result = run_privately(domain, sys.executable, '-c', SWEPT, *BALLBOT)
    assert result['outcome'] == 'passed'


def test_a_broken_port_of_another_user_holds_up_no_process_of_this_one(tmp_path, monkeypatch):
    make(tmp_path, PORT, age_s=YOUNG_S)
    monkeypatch.setattr(shared_memory.os, 'access', lambda path, mode: False)
    assert find_broken_ports(tmp_path) == []


@pytest.mark.graph
def test_a_taken_port_changes_nothing_but_the_log(domain):
    pytest.importorskip('rclpy')
    run = [*BALLBOT, 'run', 'stationary', '--no-record', '--json', '--set=plant_sim.duration=0.4']
    taken = [*private_shared_memory(), 'flock', '/dev/shm/fastrtps_port7000_el']
    done = [
        subprocess.run(
            command, env=environment(domain), capture_output=True, text=True,
            timeout=LAST_RESORT_S, check=False,
        )
        for command in ([*taken, *run], [*run, '--processes=none'])
    ]  # fmt: skip
    with_port_taken, expected = (json.loads(each.stdout)['duty_sha256'] for each in done)
    assert with_port_taken == expected
    assert 'port7000: open_and_lock_file failed' in done[0].stderr
    assert without_taken_ports(done[0].stderr) == ''
