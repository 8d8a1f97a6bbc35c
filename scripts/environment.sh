# Sourced by the other scripts and by .ci/run: chooses, creates and updates the virtual environment.
#
#   prepare_environment run|test
#
# sets `project` (the source tree) and `venv` (the virtual environment), and removes the entries of
# other environments from the environment variables. `test` installs the test tools, too. If the
# machine lacks something, it exits with one line and status 2.

project=$(dirname "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")")

# The Python 3 minor versions that the ROS 2 wheels are built for.
oldest_minor=10
newest_minor=13

# Errors of pip when it can't reach a package index.
no_network='NewConnectionError|NameResolutionError|ConnectTimeoutError|ReadTimeoutError|ProxyError'
no_network+='|Temporary failure in name resolution|Network is unreachable|Connection refused'

say() {
  printf '%s\n' "$*" >&2
}

fail() {
  say "$(basename "$0"): $*"
  exit 2
}

prepare_environment() {
  local purpose=$1 extras=
  venv=
  leave_other_environments

  if [[ ${ROS_DISTRO:-} == jazzy ]]; then
    venv=$project/.venv-jazzy
    if ! is_current "$purpose" && ! find_jazzy_python; then
      say 'note: ROS_DISTRO is jazzy, but no python3 imports rclpy: using the ROS 2 wheels in .venv'
      venv=
    fi
  elif [[ -n ${ROS_DISTRO:-} ]]; then
    say "note: the sourced ROS is '$ROS_DISTRO', not jazzy: using the ROS 2 wheels in .venv"
  fi
  if [[ -z $venv ]]; then
    venv=$project/.venv
    extras=ros
    leave_sourced_ros
  fi

  is_current "$purpose" || set_up "$purpose" "$extras"
}

# --- Other environments -------------------------------------------------------------------------

# Keeps the entries of the path variable $1 for which the test $2 fails.
drop_entries() {
  local variable=$1 test=$2 entry entries kept=() IFS=:
  [[ -n ${!variable:-} ]] || return 0
  read -ra entries <<<"${!variable}"
  for entry in "${entries[@]}"; do
    "$test" "${entry%/}" || kept+=("$entry")
  done
  if ((${#kept[@]})); then
    export "$variable=${kept[*]}"
  else
    unset "$variable"
  fi
}

is_of_this_project() {
  [[ $1 == "$project"/.venv*/bin ]]
}

is_library_of_a_venv() {
  [[ -f ${1%/*}/pyvenv.cfg || $1 == */site-packages/ros_*.libs ]]
}

is_another_ballbot() {
  [[ -d $1/ballbot_ros && ! $1/ballbot_ros -ef $project/ballbot_ros ]]
}

is_of_sourced_ros() {
  local prefix IFS=:
  [[ $1/ == /opt/ros/* ]] && return
  for prefix in $sourced_prefixes; do
    [[ -n $prefix && $1/ == "$prefix"/* ]] && return
  done
  return 1
}

leave_other_environments() {
  # The ROS 2 wheels re-execute the interpreter with the LD_LIBRARY_PATH that they need, unless this
  # variable is set. If it is inherited from a process of another environment, it is wrong.
  unset _ROS_WHEELS_BOOTSTRAP_COMPLETE
  drop_entries LD_LIBRARY_PATH is_library_of_a_venv
  unset PYTHONHOME VIRTUAL_ENV
  # An environment can't be recreated with its own interpreter.
  drop_entries PATH is_of_this_project
  # An installed copy, as in a sourced colcon workspace, would hide this source tree.
  drop_entries PYTHONPATH is_another_ballbot
}

leave_sourced_ros() {
  local variable sourced_prefixes=${AMENT_PREFIX_PATH:-}:${COLCON_PREFIX_PATH:-}
  for variable in PYTHONPATH LD_LIBRARY_PATH CMAKE_PREFIX_PATH PKG_CONFIG_PATH \
    AMENT_PREFIX_PATH COLCON_PREFIX_PATH; do
    drop_entries "$variable" is_of_sourced_ros
  done
  unset ROS_DISTRO ROS_VERSION ROS_PYTHON_VERSION
  if [[ ${RMW_IMPLEMENTATION:-rmw_fastrtps_cpp} != rmw_fastrtps_cpp ]]; then
    say "note: the ROS 2 wheels lack $RMW_IMPLEMENTATION: using rmw_fastrtps_cpp"
    unset RMW_IMPLEMENTATION
  fi
}

# --- Choosing a Python --------------------------------------------------------------------------

# Prints the minor version of the Python 3 command $1.
minor_version() {
  local answer
  answer=$("$1" -V 2>/dev/null) && [[ $answer =~ ^Python\ 3\.([0-9]+) ]] || return
  printf '%s' "${BASH_REMATCH[1]}"
}

can_make_environments() {
  "$1" -c 'import ensurepip, venv' 2>/dev/null
}

lacks_venv() {
  fail "$1 cannot make a virtual environment: sudo apt install $(basename "$1")-venv"
}

# The sourced rclpy is built for one Python only, usually the system's. Another python3 may come
# first on PATH.
find_jazzy_python() {
  local candidate
  for candidate in python3 /usr/bin/python3; do
    if command -v "$candidate" >/dev/null && "$candidate" -c 'import rclpy' 2>/dev/null; then
      python=$candidate
      return
    fi
  done
  return 1
}

find_wheel_python() {
  local candidate candidates=(python3) minor rejected='' incomplete='' wanted
  wanted="Python 3.$oldest_minor to 3.$newest_minor"
  for ((minor = newest_minor; minor >= oldest_minor; minor--)); do
    candidates+=("python3.$minor")
  done
  for candidate in "${candidates[@]}"; do
    command -v "$candidate" >/dev/null || continue
    minor=$(minor_version "$candidate") || continue
    if ((minor < oldest_minor || minor > newest_minor)); then
      rejected=${rejected:-3.$minor}
    elif ! can_make_environments "$candidate"; then
      incomplete=${incomplete:-$candidate}
    else
      python=$candidate
      return
    fi
  done
  [[ -z $incomplete ]] || lacks_venv "$incomplete"
  [[ -z $rejected ]] || fail "needs $wanted, found only $rejected: install one of them beside it"
  fail "needs $wanted, found none: sudo apt install python3 python3-venv"
}

# --- Set-up -------------------------------------------------------------------------------------

# Prints what an installation depends on. A completed installation keeps it as its stamp: if the
# first line has changed, the environment is recreated; if the second, it is updated.
wanted_stamp() {
  local minor
  minor=$(minor_version "$venv/bin/python") || return
  printf '3.%s in %s\n' "$minor" "$project"
  {
    cat "$project/setup.py" "$project/pyproject.toml"
    # The names of the nodes: each node has a command.
    grep -hs 'node: ClassVar' "$project"/ballbot_ros/parameters/*.py || true
  } | sha256sum
}

is_reusable() {
  [[ -x $venv/bin/python && -f $venv/setup.stamp ]] || return
  mapfile -t stamp <"$venv/setup.stamp"
  mapfile -t wanted < <(wanted_stamp)
  [[ ${#wanted[@]} == 2 && ${stamp[0]:-} == "${wanted[0]}" ]]
}

is_current() {
  is_reusable && [[ ${stamp[1]:-} == "${wanted[1]}" && " ${stamp[2]:-} " == *" $1 "* ]] &&
    [[ -x $venv/bin/ballbot ]]
}

set_up() {
  local purpose=$1 extras=$2 lock
  # If two scripts start at once, the second waits for the first and then has nothing to do. The
  # locked file outlives the environment.
  exec {lock}<"$project/scripts/environment.sh"
  if ! flock --nonblock "$lock"; then
    say "Waiting for another set-up of $(basename "$venv") to end ..."
    flock "$lock"
  fi
  if ! is_current "$purpose"; then
    # pip reports an interrupt as an error: exit here, without explaining that error.
    trap 'say; exit 130' INT
    if is_reusable; then
      say "Updating $(basename "$venv") ..."
      : >"$venv/setup.log"
    else
      make_environment "$extras"
    fi
    install_project "$purpose" "$extras"
    trap - INT
  fi
  exec {lock}<&-
}

make_environment() {
  local extras=$1 options=()
  if [[ -n $extras ]]; then
    [[ $(uname -sm) == 'Linux x86_64' ]] ||
      fail "the ROS 2 wheels are for Linux x86_64, this is $(uname -sm): source ROS 2 Jazzy first"
    find_wheel_python
  else
    can_make_environments "$python" || lacks_venv "$python"
    # The sourced message packages need the numpy that they were built for, the system's.
    options=(--system-site-packages)
  fi
  if [[ -e $venv && ! -e $venv/setup.log ]]; then
    rmdir "$venv" 2>/dev/null || fail "did not make $venv, so does not touch it: move it away"
  fi

  say "Setting up $(basename "$venv"): first time only, about a minute ..."
  { rm -rf "$venv" && mkdir "$venv"; } 2>/dev/null || fail "cannot write to $project"
  "$python" -m venv "${options[@]}" "$venv" >"$venv/setup.log" 2>&1 || explain_failure
  "$venv/bin/python" -m pip --version >>"$venv/setup.log" 2>&1 ||
    fail "$python makes environments without pip: sudo apt install python3-pip python3-venv"
}

install_project() {
  local purpose=$1 extras=${2:+$2,}drive,viewer purposes=run constraints=()
  if [[ $purpose == test ]]; then
    extras=$extras,test
    purposes='run test'
  fi
  if [[ $venv == *-jazzy ]]; then
    "$venv/bin/python" -c 'import numpy; print(f"numpy=={numpy.__version__}")' \
      >"$venv/constraints.txt" 2>>"$venv/setup.log" || fail 'the sourced ROS 2 Jazzy lacks numpy'
    constraints=(--constraint "$venv/constraints.txt")
  fi

  # An interrupted installation must not look complete, so the stamp loses its second line. If pip
  # itself fails, it undoes the installation, and the stamp is restored.
  if [[ -e $venv/setup.stamp ]]; then
    cp "$venv/setup.stamp" "$venv/setup.stamp.before"
    printf '%s\n' "${stamp[0]}" >"$venv/setup.stamp"
  fi
  if ! (
    cd "$project" &&
      "$venv/bin/python" -m pip install --no-input --disable-pip-version-check \
        "${constraints[@]}" --editable ".[$extras]" >>"$venv/setup.log" 2>&1
  ); then
    [[ ! -e $venv/setup.stamp.before ]] || mv "$venv/setup.stamp.before" "$venv/setup.stamp"
    explain_failure
  fi
  {
    wanted_stamp
    printf '%s\n' "$purposes"
  } >"$venv/setup.stamp.new"
  mv "$venv/setup.stamp.new" "$venv/setup.stamp"
}

explain_failure() {
  local log=$venv/setup.log reason
  if grep -qE "$no_network" "$log"; then
    reason='no network: the set-up downloads the packages it needs'
  elif grep -q 'No space left on device' "$log" ||
    (($(df --output=avail "$venv" | tail -n 1) == 0)); then
    reason='no space left on the device'
  else
    reason=$(grep -E '^ *(ERROR|error|Error)' "$log" | tail -n 1) || reason=$(tail -n 1 "$log")
    reason="the set-up failed: $reason"
  fi
  fail "$reason (details in $log)"
}
