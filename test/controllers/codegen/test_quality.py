"""The generated C: no warnings, no doubles, no findings of cppcheck."""

import re
import subprocess

import pytest
from generated import Built, commissioning, need, need_command
from parts import values_of

from ballbot_ros.controllers.codegen.toolchain import TARGET_FOLDER, TARGETS, WARNINGS, build
from ballbot_ros.errors import CodegenError
from ballbot_ros.parameters import CONTROLLER

SOURCES = ('ballbot_controller.c', 'ballbot_parameters.c', 'ballbot_app.c')
DOUBLE_ROUTINES = {'__aeabi_f2d', '__aeabi_dadd', '__aeabi_d2iz', '__aeabi_dcmpgt',
                   '__aeabi_dcmplt', 'floor'}  # fmt: skip


@pytest.mark.parametrize('target', TARGETS)
def test_it_builds_without_a_warning(built, target):
    assert {'-Wall', '-Wextra', '-Werror', '-Wdouble-promotion', '-Wfloat-conversion'} <= set(
        WARNINGS
    )
    made = built(target)
    assert made.command


def test_a_folder_that_was_built_with_the_platform_still_builds(built, tmp_path):
    made = built('c')
    (made.folder / 'kernel_id.h').write_text('#define task_init ((TaskType)0)\n')
    assert build(made.folder, TARGETS['c'], tmp_path / 'again')


@pytest.mark.parametrize('target', TARGETS)
@pytest.mark.parametrize(
    ('right', 'slip'),
    [
        ('/ 1000.0f * k_i', '/ 1000.0 * k_i'),
        ('float feedback = 0.0f;', 'double feedback = 0.0f;'),
        ('fabsf(plane->theta_diff)', 'fabs(plane->theta_diff)'),
        ('percent = (S8)duty;', 'percent = duty;'),
    ],
)
def test_an_accidental_double_or_implicit_conversion_does_not_build(
    built, tmp_path, target, right, slip
):
    made = built(target)
    source = made.folder / 'ballbot_controller.c'
    text = source.read_text()
    assert text.count(right) == 1
    source.write_text(text.replace(right, slip))
    with pytest.raises(CodegenError, match=r'Werror=(double-promotion|float-conversion)'):
        build(made.folder, TARGETS[target], tmp_path / 'slip')


def test_the_only_doubles_round_the_logged_pitch(built):
    made = built('arm')
    listing = subprocess.run(
        ['arm-none-eabi-nm', '-u', made.scratch / 'ballbot_controller.o'],
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    undefined = set(re.findall(r'U (\w+)', listing))
    doubles = {name for name in undefined if re.match(r'__aeabi_(d|\w*2d)', name)}
    assert doubles | {'floor'} == DOUBLE_ROUTINES
    text = (made.folder / 'ballbot_controller.c').read_text()
    code = re.sub(r'/\*.*?\*/', '', text, flags=re.DOTALL)
    assert len(re.findall(r'\bdouble\b', code)) == 2
    # Only these constants have type double.
    assert re.findall(r'\b\d+\.\d+(?![\dfe])', code) == ['0.5', '32767.0', '32768.0']


def test_the_makefile_needs_no_flag_that_the_platforms_old_compiler_does_not_know(built):
    made = built('arm')
    assert 'FLAGS' not in (made.folder / 'Makefile').read_text()
    contracted = built('arm', name='contracted', flags=('-ffp-contract=fast',))
    for name in ('ballbot_controller.o', 'ballbot_parameters.o', 'ballbot_app.o'):
        assert (made.scratch / name).read_bytes() == (contracted.scratch / name).read_bytes()


def test_the_platform_finds_the_names_it_calls(built):
    need('arm')
    made = built('arm')
    listing = subprocess.run(
        ['arm-none-eabi-nm', '--defined-only', made.scratch / 'ballbot_app.o',
         made.scratch / 'ballbot_controller.o'],
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    for name in ('ecrobot_device_initialize', 'ecrobot_device_terminate', 'user_1ms_isr_type2',
                 *(f'TaskMain_{task.name}' for task in made.tasks)):  # fmt: skip
        assert f' T {name}\n' in listing


def test_a_constant_with_a_name_of_the_platforms_does_not_build(built, tmp_path):
    made = built('c')
    for name in ('ballbot_controller.c', 'ballbot_parameters.c', 'ballbot_parameters.h'):
        path = made.folder / name
        path.write_text(path.read_text().replace('sound_frq', 'sound_freq'))
    with pytest.raises(CodegenError, match='sound_freq'):
        build(made.folder, TARGETS['c'], tmp_path / 'taken')


@pytest.fixture(scope='module', params=['balance', 'commissioning'])
def application(request, tmp_path_factory):
    need('c')
    values = values_of(CONTROLLER) if request.param == 'balance' else commissioning()
    return Built(values, 'c', tmp_path_factory.mktemp('quality'))


def cppcheck(application, *options):
    need_command('cppcheck', 'cppcheck')
    return subprocess.run(
        ['cppcheck', '--quiet', '--std=c99', '--platform=arm32-wchar_t4', *options,
         f'-I{application.scratch}', f'-I{TARGET_FOLDER}',
         *(str(application.folder / name) for name in SOURCES)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip


def test_cppcheck_finds_nothing(application):
    done = cppcheck(
        application, '--error-exitcode=1', '--enable=warning,style,performance,portability'
    )
    assert done.returncode == 0, done.stderr


def test_cppchecks_misra_rules_find_nothing_in_the_generated_files(application):
    done = cppcheck(application, '--addon=misra', '--enable=style')
    assert 'misra-c2012' in done.stderr, 'the stand-in headers are known to break some'
    found = [line for line in done.stderr.splitlines() if 'misra-c2012' in line]
    assert [line for line in found if str(application.folder) in line] == []
