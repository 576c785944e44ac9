# SPDX-License-Identifier: Apache-2.0
# Headers of the compiler's own C++ library, for builds against a C library that is not the compiler's.
#
# With picolibc as a module Zephyr gives -nostdinc, which hides them. They must come first, because
# they wrap the C headers and reach the real ones by #include_next. Zephyr's SDK needs none of this: it
# brings a picolibc of its own. bv_use_libstdcxx() after bv_library() opens them to that library.

set(bv_libstdcxx)
if(CONFIG_EXTERNAL_LIBCPP AND CONFIG_PICOLIBC_USE_MODULE)
  execute_process(
    COMMAND ${CMAKE_CXX_COMPILER} ${TOOLCHAIN_C_FLAGS} -E -v -x c++ /dev/null
    OUTPUT_QUIET ERROR_VARIABLE searched COMMAND_ERROR_IS_FATAL ANY
  )
  string(REGEX MATCHALL "\n [^\n]*/c\\+\\+/[^\n]*" folders "${searched}")
  foreach(folder ${folders})
    string(STRIP "${folder}" folder)
    list(APPEND bv_libstdcxx ${folder})
  endforeach()
  if(NOT bv_libstdcxx)
    message(FATAL_ERROR
      "${CMAKE_CXX_COMPILER} has no C++ library. Debian: apt install libstdc++-arm-none-eabi-newlib")
  endif()
endif()

macro(bv_use_libstdcxx)
  target_include_directories(${ZEPHYR_CURRENT_LIBRARY} SYSTEM BEFORE PRIVATE
    "$<$<COMPILE_LANGUAGE:CXX>:${bv_libstdcxx}>")
endmacro()
