# shellcheck shell=bash disable=SC2034,SC2054
# Sourced by the scripts that compile without CMake or leave the host: flags, emulators, and the Debian packages that
# bring them. Expects $root; EIGEN may be given by the environment.

# As core/CMakeLists.txt hands on, for every compiler; and for GCC of this host.
as_core_asks=(-std=c++20 -DNDEBUG -ffp-contract=off -DEIGEN_DONT_VECTORIZE -I "$root"
              -isystem "${EIGEN:-/usr/include/eigen3}")
of_gcc=()
case $(g++ -dumpfullversion 2>/dev/null) in 12.*) of_gcc=(-fno-tree-slp-vectorize) ;; esac

cross_packages=(gcc-arm-none-eabi libnewlib-arm-none-eabi libstdc++-arm-none-eabi-newlib qemu-system-arm
                g++-aarch64-linux-gnu qemu-user)

# A Cortex-M7 with double precision in hardware: no heap, no exceptions, no type information, no stdio.
cortex_m7=(-mcpu=cortex-m7 -mthumb -mfpu=fpv5-d16 -mfloat-abi=hard -fno-exceptions -fno-rtti -fno-threadsafe-statics
           -ffunction-sections -fdata-sections -DEIGEN_NO_MALLOC -nostartfiles -Wl,--gc-sections
           -T "$root/bench/firmware/cortex_m7.ld" "$root/bench/firmware/board_cortex_m7.cpp")

# Runs an image on the mps2-an500 board, one nanosecond an instruction; exits as its main() does.
mps2_an500=(qemu-system-arm -M mps2-an500 -cpu cortex-m7 -icount shift=0 -nographic -monitor none
            -chardev stdio,id=host -semihosting-config enable=on,target=native,chardev=host)
on_cortex_m7() { "${mps2_an500[@]}" -serial none -kernel "$1" </dev/null; }

# Fails where an image could allocate, print or throw.
without_allocator() {
  if arm-none-eabi-nm -C "$1" | grep -iE 'malloc|calloc|realloc|free|operator (new|delete)|sbrk|printf|throw'; then
    echo "an allocator or stdio is linked in"
    return 1
  fi
  echo "no allocator, no stdio, no exceptions linked in"
}

# Names of the commands that are not there.
lacking() {
  local command
  for command in "$@"; do command -v "$command" >/dev/null || printf '%s ' "$command"; done
}

install_cross_toolchains() {
  if ! command -v apt-get >/dev/null; then
    echo "this is no Debian; install the like of: ${cross_packages[*]}" >&2
    return 1
  fi
  local as_root=()
  [[ $(id -u) -eq 0 ]] || as_root=(sudo)
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq update &&
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends \
      "${cross_packages[@]}" >/dev/null
}
