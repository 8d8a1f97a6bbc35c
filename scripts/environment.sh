# Sourced by the other scripts and by .ci/run. `prepare_environment run` sets `project`, the source
# tree, and `venv`, its virtual environment, which it creates or updates if necessary, with what a
# first run needs; the command installs more when it needs it. With another word it installs
# everything and the extra of this name: `test` the test tools, `docs` those of the documentation
# site, `notebook` JupyterLab. If it fails, it exits with one line and status 2.

project=$(dirname "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")")

fail() {
  echo "$(basename "$0"): $*" >&2
  exit 2
}

prepare_environment() {
  local options=() extras=drive,viewer,gym,mpc modules=ensurepip
  venv=$project/.venv
  if [[ ${ROS_DISTRO:-} == jazzy ]]; then
    venv+=-jazzy options=(--system-site-packages) modules+=,numpy,rclpy
  else
    extras=ros,$extras
    if [[ -n ${ROS_DISTRO:-} ]]; then
      echo "note: the sourced ROS is $ROS_DISTRO, not jazzy: using the ROS 2 wheels" >&2
      unset ROS_DISTRO {AMENT,CMAKE,COLCON}_PREFIX_PATH LD_LIBRARY_PATH PYTHONPATH
    fi
  fi
  is_current "$1" || set_up "$1" || exit
  # An installed copy of the package, as in a sourced workspace, would hide this source tree.
  export PYTHONPATH=$project${PYTHONPATH:+:$PYTHONPATH}
}

# Replaces this shell by a program of the folder scripts/programs, given by its module.
run_program() {
  cd "$project"
  export PYTHONPATH=$project/scripts/programs:$PYTHONPATH
  exec "$venv/bin/python" -m "$@"
}

is_current() {
  [[ -e $venv/$1.stamp && $(<"$venv/$1.stamp") == "$(stamp)" ]]
}

# Prints what an installation depends on, including the nodes, each of which has a command, and the
# files that are linked.
stamp() {
  echo "$("$venv/bin/python" -V 2>&1) in $project"
  grep -h 'node: ClassVar' "$project"/ballbot_ros/parameters/*.py
  printf '%s\n' "$project"/launch/*.launch.py
  cat "$project"/{setup.py,pyproject.toml,scripts/environment.sh}
}

set_up() (
  log=$venv/setup.log numpy=
  # Nothing failed: do not go on to say so.
  trap 'echo >&2; exit 130' INT
  echo "Setting up ${venv##*/} for scripts/${0##*/}, the first time ..." >&2
  # If two scripts start at once, the second one waits and then has nothing to do.
  cd "$project" && exec {lock}<setup.py && flock "$lock" || exit 2
  ! is_current "$1" || exit 0
  # Create it if its first set-up was interrupted, or if it was moved or its Python replaced.
  [[ -e $venv/run.stamp && $("$venv/bin/pip" -V 2>/dev/null) == *" $venv/"* ]] || create
  [[ $1 == run ]] || extras+=,all,$1
  # The sourced message packages need the numpy that they were built for.
  [[ $venv == *.venv ]] || numpy=$("$venv/bin/python" -c 'import numpy; print(numpy.__version__)')
  "$venv/bin/python" -m ballbot_ros.cli.installation "${0##*/}" "$log" -e ".[$extras]" \
    ${numpy:+"numpy==$numpy"} && index_package || exit 2
  for purpose in run "$1"; do stamp >"$venv/$purpose.stamp"; done
)

# Makes the environment a prefix in which `ros2` finds the package, as colcon does. These are links
# to this source tree, since pip installs no data files in editable mode. Each launch file has its
# own: `ros2 launch` does not look into linked folders.
index_package() {
  local index=$venv/share/ament_index/resource_index/packages program
  local share=$venv/share/ballbot_ros programs=$venv/lib/ballbot_ros
  rm -rf "$share" "$programs" && mkdir -p "$index" "$share/launch" "$programs" &&
    ln -sf "$project/resource/ballbot_ros" "$index" &&
    ln -s "$project"/{package.xml,config} "$share" &&
    ln -s "$project"/launch/*.launch.py "$share/launch" || return
  for program in "$venv"/bin/*; do
    ! grep -qs '^from ballbot_ros\.' "$program" || ln -s "$program" "$programs" || return
  done
}

create() {
  [[ ! -e $venv || -e $log ]] || fail "$venv was not made by these scripts: move it away"
  # Remove it first: if it is active, its Python is the first on PATH.
  rm -rf "$venv" && mkdir "$venv" && : >"$log" || exit 2
  supported="import sys, $modules; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))"
  for python in python3{,.13,.12,.11,.10} ''; do
    ! "$python" -c "$supported" 2>/dev/null || break
  done
  [[ -n $python ]] ||
    fail "found no Python 3.10 to 3.13 that imports $modules: sudo apt install python3-venv"
  "$python" -m venv "${options[@]}" "$venv" >"$log" 2>&1 ||
    fail "cannot create $venv (details in $log)"
}
