#!/usr/bin/env bash
# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
# Generates tf2_msgs in FOLDER from wheels (CMake and a C++ compiler are needed), and runs the tests of TF with it:
#   test/tf_messages/make.sh FOLDER
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
folder=$(mkdir -p "${1:?usage: make.sh FOLDER}" && cd "$1" && pwd)
wheels=(rclpy common-interfaces rmw-fastrtps-cpp rosidl-default-generators rosidl-core-generators
  ament-package python-cmake-module fastrtps-cmake-module rosidl-generator-type-description
  gtest-vendor gmock-vendor domain-coordinator rcutils rpyutils tracetools ament-cmake
  ament-cmake-{core,export-definitions,export-dependencies,export-include-directories}
  ament-cmake-{export-interfaces,export-libraries,export-link-flags,export-targets}
  ament-cmake-{gen-version-h,gmock,gtest,include-directories,libraries,pytest,python,ros}
  ament-cmake-{target-dependencies,test,vendor-package,version})
"${PYTHON:-python3}" -m venv "$folder/venv"
prefix=$folder/venv
"$prefix/bin/pip" install --quiet "${wheels[@]/#/ros-jazzy-}" 'empy<4' lark catkin_pkg pytest \
  hypothesis psutil setuptools wheel "$here/../.."
# The wheels name the folders of the machine that built them.
include=$("$prefix/bin/python" -c 'import sysconfig; print(sysconfig.get_path("include"))')
numpy=$("$prefix/bin/python" -c 'import numpy; print(numpy.get_include())')
grep -rlE '/opt/python/' "$prefix/share" --include='*.cmake' | xargs sed -i -E \
  -e "s#/opt/python/[^;\"]*/numpy/_?core/include#$numpy#g" \
  -e "s#/opt/python/[^;\"]*/include/python3[.0-9]*#$include#g"
export AMENT_PREFIX_PATH=$prefix CMAKE_PREFIX_PATH=$prefix PATH=$prefix/bin:$PATH
cmake -S "$here" -B "$folder/build" -DCMAKE_INSTALL_PREFIX="$folder/install" -DBUILD_TESTING=OFF \
  -DPython3_EXECUTABLE="$prefix/bin/python" >"$folder/cmake.log"
cmake --build "$folder/build" --target install -j2 >"$folder/build.log"
modules=$(dirname "$(find "$folder/install" -type d -name tf2_msgs -path '*-packages*')")
cd "$here/../.."
PYTHONPATH=$PWD:$modules LD_LIBRARY_PATH=$folder/install/lib AMENT_PREFIX_PATH=$folder/install \
  "$prefix/bin/python" -m pytest test/test_ros_tf.py
