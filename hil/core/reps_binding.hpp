// SPDX-License-Identifier: Apache-2.0
#ifndef HIL_CORE_REPS_BINDING_HPP_
#define HIL_CORE_REPS_BINDING_HPP_

#include <nanobind/nanobind.h>

/// Adds the detector of repetitions to the module.
void bind_reps(nanobind::module_ &m);

#endif // HIL_CORE_REPS_BINDING_HPP_
