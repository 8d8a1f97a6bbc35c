"""One plant per domain on this machine, whatever files exist."""

import tempfile

import pytest

from ballbot_ros.errors import BallbotError
from ballbot_ros.nodes.middleware import LOCK_FD_ENV, DomainLock


def test_a_second_lock_is_refused_until_the_first_is_released(domain):
    lock = DomainLock(domain)
    with pytest.raises(BallbotError, match=f'another plant, player .* ROS domain {domain}'):
        DomainLock(domain)
    lock.release()
    DomainLock(domain).release()


def test_an_inherited_lock_is_the_same_lock(domain, monkeypatch):
    lock = DomainLock(domain)
    monkeypatch.setenv(LOCK_FD_ENV, str(lock.file))
    assert DomainLock(domain).file == lock.file
    lock.release()


def test_it_holds_between_terminals_with_other_folders_for_temporary_files(
    domain, tmp_path, monkeypatch
):
    lock = DomainLock(domain)
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))
    with pytest.raises(BallbotError, match='another plant'):
        DomainLock(domain)
    lock.release()


def test_foreign_files_do_not_block_it(domain, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))
    (tmp_path / f'ballbot_ros_plant_{domain}.lock').symlink_to(tmp_path / 'no' / 'file')
    DomainLock(domain).release()
