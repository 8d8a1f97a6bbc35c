"""Writes the missing parts of studies, and kills itself doing so.

Each line of the input has a delay [s], after which the writing process is killed, or nothing, and a
folder. The exit status of the process is printed. A fork is much faster than a new interpreter, so
that a test can kill a hundred.
"""

import os
import signal
import sys
import time
from pathlib import Path

from study_folders import NOW, record, rows_of

from ballbot_ros.study.data_set import begin_or_resume
from ballbot_ros.study.part_file import load_pyarrow, write_part

SMALL = {'runs': 1600, 'runs_per_part': 8}


def write_missing(folder):
    """Resume the study, check all parts, and write the missing ones."""
    study = record(**SMALL)
    with begin_or_resume(folder, study, NOW) as begun:
        check = begun.check_parts()
        assert check.notices == [], check.notices
        for part in check.missing:
            write_part(folder, study, part, rows_of(study, part))
        assert begun.finish(NOW).missing == []


def main():
    load_pyarrow()
    for line in sys.stdin:
        delay_s, folder = line.strip('\n').split('\t')
        process = os.fork()
        if process == 0:
            status = 1
            try:
                write_missing(Path(folder))
                status = 0
            finally:
                os._exit(status)
        if delay_s:
            time.sleep(float(delay_s))
            os.kill(process, signal.SIGKILL)
        print(os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]), flush=True)


if __name__ == '__main__':
    main()
