// SPDX-License-Identifier: Apache-2.0
#ifndef HIL_CORE_CALIB_BINDING_HPP_
#define HIL_CORE_CALIB_BINDING_HPP_

#include <nanobind/nanobind.h>

/// Adds the calibration functions to the module.
void bind_calib(nanobind::module_ &m);

#endif // HIL_CORE_CALIB_BINDING_HPP_
