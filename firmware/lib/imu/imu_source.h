/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * Where IMU batches come from. One source is linked in, chosen by Kconfig; applications do not
 * know which.
 */
#ifndef BV_IMU_SOURCE_H_
#define BV_IMU_SOURCE_H_

#include "wire.h"

#ifdef __cplusplus
extern "C" {
#endif

/**
 * Takes one batch, in the source's own thread. @p batch is valid during the call only.
 *
 * Everything is filled in but `source`: times are on this node's sync clock, `period_ticks` is
 * the measured period in 1/256 tick, `sample_index` counts from 0 without gaps unless samples
 * were lost.
 */
typedef void (*imu_source_batch_cb)(const struct wire_imu_batch *batch);

/**
 * Start sampling. sync_timer_init() must have succeeded.
 *
 * @return 0, or a negative errno of the device; -EALREADY when running.
 */
int imu_source_start(imu_source_batch_cb on_batch);

/** Stop sampling; at most one more batch is delivered. */
void imu_source_stop(void);

#ifdef __cplusplus
}
#endif

#endif /* BV_IMU_SOURCE_H_ */
