# SPDX-License-Identifier: MIT
# find_package(meshkal) gives the target meshkal::meshkal. Everything is named from this file's own place, so that the tree can be moved.
get_filename_component(meshkal_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
if(NOT TARGET meshkal::meshkal)
  add_library(meshkal::meshkal STATIC IMPORTED)
  # Unrolled kernels are compiled in the caller's units: without the option their bits depend on the target.
  set_target_properties(meshkal::meshkal PROPERTIES
    IMPORTED_LOCATION "${meshkal_prefix}/lib/libmeshkal.a"
    IMPORTED_LINK_INTERFACE_LANGUAGES C
    INTERFACE_INCLUDE_DIRECTORIES "${meshkal_prefix}/include"
    INTERFACE_COMPILE_OPTIONS "$<$<COMPILE_LANGUAGE:C,CXX>:-ffp-contract=off>"
    INTERFACE_LINK_LIBRARIES m)
endif()
foreach(meshkal_file include/meshkal/rkfd.h lib/libmeshkal.a)
  if(NOT EXISTS "${meshkal_prefix}/${meshkal_file}")
    set(meshkal_FOUND FALSE)
    set(meshkal_NOT_FOUND_MESSAGE "${meshkal_prefix}/${meshkal_file} is missing: the installation is not complete")
  endif()
endforeach()
unset(meshkal_file)
unset(meshkal_prefix)
