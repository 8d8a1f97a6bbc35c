"""What the import needs and does."""

import subprocess
import sys


def run(code):
    return subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=False)


def test_without_gymnasium_the_import_says_what_to_install():
    done = run("import sys; sys.modules['gymnasium'] = None; import ballbot_ros.environments")
    assert done.stderr.splitlines()[-1].startswith('ImportError: gymnasium not found (')
    assert done.stderr.endswith('install it with `pip install "ballbot_ros[gym]"`\n')
    assert 'During handling' not in done.stderr


def test_only_the_environments_need_gymnasium_and_they_need_no_ros():
    code = (
        'import sys\n'
        'import ballbot_ros.controllers.policy, ballbot_ros.run.library\n'
        "assert 'gymnasium' not in sys.modules\n"
        'import ballbot_ros.environments\n'
        "assert 'rclpy' not in sys.modules\n"
    )
    done = run(code)
    assert (done.returncode, done.stderr) == (0, '')
