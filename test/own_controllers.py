"""Controllers as users write them: one that balances, and some that fail."""

import re
from pathlib import Path

PAGE = Path(__file__).parents[1] / 'docs' / 'controllers.md'
BALANCE = re.search(r'```python\n(.*?)```', PAGE.read_text(encoding='utf-8'), re.DOTALL).group(1)
"""The controller on the page of controllers."""

FAULTY = """\
import math
import signal
import sys
import time

from ballbot_ros.controllers import Controller


class Faulty(Controller):
    def tick(self, readings):
        return (0, 0) if readings.elapsed_ms < 400 else self.fail(readings)


class ReturnsNaN(Faulty):
    def fail(self, readings):
        return math.nan, 0


class ReturnsFloats(Faulty):
    def fail(self, readings):
        return 1.0, 2.0


class ReturnsTooMuch(Faulty):
    def fail(self, readings):
        return 300, 0


class ReturnsOne(Faulty):
    def fail(self, readings):
        return 3


class ReturnsNone(Faulty):
    def fail(self, readings):
        pass


class ReturnsBool(Faulty):
    def fail(self, readings):
        return True, False


class Raises(Faulty):
    def fail(self, readings):
        return 1 // 0, 0


class RaisesInALibrary(Faulty):
    def fail(self, readings):
        return int('two\\nlines'), 0


class RaisesAtOnce(Controller):
    def tick(self, readings):
        raise RuntimeError('no')


class Exits(Faulty):
    def fail(self, readings):
        sys.exit(3)


class WritesToItsInputs(Faulty):
    def fail(self, readings):
        readings.gyro = (0, 0)


class WritesIntoItsInputs(Faulty):
    def fail(self, readings):
        readings.gyro[0] = 0


class Blocks(Faulty):
    def fail(self, readings):
        while True: pass


class Sleeps(Faulty):
    def fail(self, readings):
        time.sleep(1000.0)


class SleepsInAnyCase(Faulty):
    def fail(self, readings):
        while True:
            try:
                time.sleep(1000.0)
            except:
                pass


class SleepsWhenStopped(Faulty):
    def fail(self, readings):
        signal.raise_signal(signal.SIGINT)
        time.sleep(1000.0)


class Estimates(Faulty):
    def fail(self, readings):
        self.x = 3
        return 0, 0


class DeletesItsEstimates(Faulty):
    def fail(self, readings):
        del self.x
        return 0, 0


class Strange(BaseException):
    def __str__(self):
        raise ValueError


class RaisesAnything(Faulty):
    def fail(self, readings):
        raise Strange


class Interrupts(Faulty):
    def fail(self, readings):
        raise KeyboardInterrupt


class Lines:
    def __repr__(self):
        return 'A\\nB\\x1bC'


class ReturnsLines(Faulty):
    def fail(self, readings):
        return Lines()


class ReturnsAHugeNumber(Faulty):
    def fail(self, readings):
        return 10**5000, 0


class ReturnsAHugeText(Faulty):
    def fail(self, readings):
        return 'x' * 10_000_000


class Slow(Controller):
    def tick(self, readings):
        time.sleep(0.005)
        return 0, 0


class Prints(Controller):
    def tick(self, readings):
        print('here')
        return 0, 0
"""


def line_in_faulty(text):
    """Return the number of the first line that contains a text."""
    return next(n for n, line in enumerate(FAULTY.splitlines(), 1) if text in line)
