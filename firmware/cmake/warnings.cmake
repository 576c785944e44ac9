# SPDX-License-Identifier: Apache-2.0

# Warnings for our own sources and headers. Headers of Zephyr and its modules are not written for
# -Wconversion: named with -isystem, they are system headers to our targets and give none. (gcc then
# ignores the -I of the same folder.)
function(bv_warnings target)
  target_compile_options(${target} PRIVATE -Wall -Wextra -Wconversion)
  foreach(folder
    ${ZEPHYR_BASE}/include
    ${CMAKE_BINARY_DIR}/zephyr/include/generated
    ${CMAKE_BINARY_DIR}/zephyr/include/generated/zephyr
    ${ZEPHYR_BASE}/boards/native/nrf_bsim/common/cmsis
    ${ZEPHYR_BASE}/subsys/bluetooth
    ${ZEPHYR_BASE}/subsys/bluetooth/controller/ll_sw/nordic/hal/nrf5/nrfx_glue
    ${ZEPHYR_BASE}/modules/cmsis
    ${ZEPHYR_CMSIS_MODULE_DIR}/CMSIS/Core/Include
    ${ZEPHYR_BASE}/modules/hal_nordic/nrfx
    ${ZEPHYR_HAL_NORDIC_MODULE_DIR}/nrfx
    ${ZEPHYR_HAL_NORDIC_MODULE_DIR}/nrfx/drivers/include
    ${ZEPHYR_HAL_NORDIC_MODULE_DIR}/nrfx/mdk
    ${ZEPHYR_HAL_ST_MODULE_DIR}/sensor/stmemsc/lsm6dsox_STdC/driver
  )
    target_compile_options(${target} PRIVATE "SHELL:-isystem ${folder}")
  endforeach()
endfunction()
