#!/usr/bin/env bash
# Checks the system libraries that Python packages cannot bring along, and installs the missing ones
# where that is possible without a password. Otherwise prints the one command that does.
set -euo pipefail

declare -A package_of=(
  [libusb-1.0.so.0]=libusb-1.0-0        # open3d
  [libEGL.so.1]=libegl1                 # headless rendering
  [libGL.so.1]=libgl1                   # headless rendering, open3d
  [libgomp.so.1]=libgomp1               # open3d, torch
)
missing=()
known=$(ldconfig -p 2>/dev/null || /sbin/ldconfig -p)
for library in "${!package_of[@]}"; do
  grep -q "$library" <<<"$known" || missing+=("${package_of[$library]}")
done
# Mesa's software rasteriser; a vendor's driver (NVIDIA's EGL) does as well.
rasteriser=
for pattern in '/usr/lib/*/dri/*swrast*' '/usr/lib/*/libgallium*' '/usr/lib64/dri/*swrast*' \
    '/usr/lib64/libgallium*' '/usr/share/glvnd/egl_vendor.d/10_nvidia.json'; do
  if compgen -G "$pattern" >/dev/null; then rasteriser=found; fi
done
[ -n "$rasteriser" ] || missing+=(libgl1-mesa-dri)
[ ${#missing[@]} -eq 0 ] && exit 0

command="apt-get update && apt-get install -y --no-install-recommends ${missing[*]}"
if [ "$(id -u)" -eq 0 ] && command -v apt-get >/dev/null; then
  echo "installing system libraries: ${missing[*]}"
  apt-get update -qq && DEBIAN_FRONTEND=noninteractive \
    apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
elif command -v apt-get >/dev/null; then
  echo "System libraries are missing: ${missing[*]}. Install them with:" >&2
  echo "    sudo sh -c '$command'" >&2
  exit 1
else
  echo "System libraries are missing (Debian's names): ${missing[*]}. Install your system's packages of them." >&2
  exit 1
fi
