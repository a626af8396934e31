# Installs core, and builds and runs a project that finds it by CMAKE_PREFIX_PATH alone: once from this build, once from
# a configuration of core only in which no other package can be found.
cmake_minimum_required(VERSION 3.25)

function(run)
  execute_process(COMMAND ${ARGV} RESULT_VARIABLE status OUTPUT_VARIABLE output ERROR_VARIABLE output)
  if(NOT status EQUAL 0)
    string(REPLACE ";" " " command "${ARGV}")
    message(FATAL_ERROR "${command}\n${output}")
  endif()
endfunction()

set(common -G ${GENERATOR} -D CMAKE_CXX_COMPILER=${COMPILER} -D CMAKE_BUILD_TYPE=Release -D Eigen3_DIR=${EIGEN})
file(REMOVE_RECURSE ${SCRATCH})

run(${CMAKE_COMMAND} --install ${BUILD} --component core --prefix ${SCRATCH}/prefix)
run(${CMAKE_COMMAND} -S ${SOURCE}/tests/consumer -B ${SCRATCH}/build ${common} -D CMAKE_PREFIX_PATH=${SCRATCH}/prefix)
run(${CMAKE_COMMAND} --build ${SCRATCH}/build)
run(${SCRATCH}/build/consumer)

set(without)
foreach(package CLI11 nlohmann_json Catch2 benchmark PkgConfig Threads)
  list(APPEND without -D CMAKE_DISABLE_FIND_PACKAGE_${package}=ON)
endforeach()
run(${CMAKE_COMMAND} -S ${SOURCE} -B ${SCRATCH}/core_build ${common} -D SALTUS_CORE_ONLY=ON ${without})
run(${CMAKE_COMMAND} --install ${SCRATCH}/core_build --prefix ${SCRATCH}/core_prefix)

# Both ways install the same files, and headers only where they belong.
foreach(prefix prefix core_prefix)
  file(GLOB_RECURSE ${prefix}_files RELATIVE ${SCRATCH}/${prefix} ${SCRATCH}/${prefix}/*)
endforeach()
if(NOT prefix_files STREQUAL core_prefix_files)
  message(FATAL_ERROR "installed from the whole: ${prefix_files}\ninstalled from core only: ${core_prefix_files}")
endif()
foreach(file IN LISTS prefix_files)
  if(NOT file MATCHES "^(include/saltus/core/.+\\.hpp|share/cmake/saltus/saltus[A-Za-z]+\\.cmake)$")
    message(FATAL_ERROR "${file} is installed but is no part of core")
  endif()
endforeach()
