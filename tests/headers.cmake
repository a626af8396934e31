# Every header compiles alone, included twice; those of core also without exceptions and type information.
# Built by the test, not by `all`, so that a header that fails is a failed test.
add_custom_target(headers)

function(saltus_headers room)
  file(GLOB_RECURSE headers CONFIGURE_DEPENDS RELATIVE ${PROJECT_SOURCE_DIR} ${PROJECT_SOURCE_DIR}/${room}/*.hpp)
  set(sources)
  foreach(header IN LISTS headers)
    set(source ${CMAKE_CURRENT_BINARY_DIR}/headers/${header}.cpp)
    file(CONFIGURE OUTPUT ${source} CONTENT "#include \"${header}\"\n#include \"${header}\"\n")
    list(APPEND sources ${source})
  endforeach()
  if(sources)
    add_library(headers_${room} OBJECT EXCLUDE_FROM_ALL ${sources})
    target_link_libraries(headers_${room} PRIVATE saltus::${room} saltus::warnings)
    target_compile_options(headers_${room} PRIVATE -O0 -g0 ${ARGN})
    add_dependencies(headers headers_${room})
  endif()
endfunction()

saltus_headers(core -fno-exceptions -fno-rtti)
saltus_headers(hal)
saltus_headers(sim)
if(TARGET headers_sim AND TARGET CLI11::CLI11)
  target_link_libraries(headers_sim PRIVATE CLI11::CLI11)
endif()

add_test(NAME headers COMMAND ${CMAKE_COMMAND} --build ${PROJECT_BINARY_DIR} --target headers)
set_tests_properties(headers PROPERTIES TIMEOUT 900 PROCESSORS 2)
