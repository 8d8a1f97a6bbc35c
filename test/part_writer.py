"""Writes the missing parts of studies in processes that are killed doing so.

Each line of the input has a number of parts, a delay [s], and a folder: the writing process is
killed at this delay after it has written so many parts, or never if there is no number. Its exit
status is printed. A fork is much faster than a new interpreter, so that a test can kill a hundred.
"""

import os
import signal
import sys
import time
from pathlib import Path

from study_folders import NOW, encoded, record, rows_of, write_part

from ballbot_ros.lab.studies.data_set import begin_or_resume

SMALL = {'runs': 480, 'runs_per_part': 8}


def write_missing(folder, report):
    """Resume the study, check all parts, and write the missing ones."""
    study = record(**SMALL)
    with begin_or_resume(folder, study, NOW) as begun:
        check = begun.check_parts()
        assert check.notices == [], check.notices
        for part in check.missing:
            write_part(folder, study, part, rows_of(study, part))
            report()
        assert begun.finish(NOW).missing == []


def write_in_fork(folder, parts, delay_s):
    """Return the exit status of a process that writes, and is killed."""
    read, write = os.pipe()
    process = os.fork()
    if process == 0:
        status = 1
        try:
            os.close(read)
            write_missing(folder, lambda: os.write(write, b'.'))
            status = 0
        finally:
            os._exit(status)
    os.close(write)
    if parts:
        for _ in range(int(parts)):
            os.read(read, 1)
        time.sleep(delay_s)
        # It may have ended, but its number is kept until it is waited for.
        os.kill(process, signal.SIGKILL)
    status = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    os.close(read)
    return status


def main():
    # The first part takes a quarter of a second, which every process would need again.
    study = record(**SMALL)
    encoded(study, 0, rows_of(study, 0))
    for line in sys.stdin:
        parts, delay_s, folder = line.strip('\n').split('\t')
        print(write_in_fork(Path(folder), parts, float(delay_s)), flush=True)


if __name__ == '__main__':
    main()
