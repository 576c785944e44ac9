/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * The node's IMU: corrected batches to the application, at the sensor's rate or decimated; FIFO
 * statistics and faults to the diagnostic stream.
 */
#ifndef BV_IMU_SOURCE_H_
#define BV_IMU_SOURCE_H_

#include "wire.h"

#ifdef __cplusplus
extern "C" {
#endif

/**
 * Takes one batch, in the driver's thread. @p batch is valid during the call only.
 *
 * Everything is filled in but `source`: times are on this node's sync clock, `period_ticks` is
 * the measured period in 1/256 tick, `sample_index` counts from 0 without gaps unless samples
 * were lost. Counts are corrected, or WIRE_IMU_FLAG_UNCORRECTED is set; see calib.h.
 */
typedef void (*imu_source_batch_cb)(const struct wire_imu_batch *batch);

/**
 * Start sampling as devicetree and Kconfig say. sync_timer_init() must have succeeded, and
 * cal_init() come before.
 *
 * @return 0, or a negative errno of the device; -EALREADY when running.
 */
int imu_source_start(imu_source_batch_cb on_batch);

/**
 * Start anew with other settings; samples count from 0 again. After imu_source_start(), and not
 * from the batch callback.
 *
 * @return 0; -EINVAL for a rate or scale that the sensor does not have, and then nothing changes;
 *         -EAGAIN before imu_source_start(); or as that.
 */
int imu_source_setup(const struct wire_imu_setup *setup);

#ifdef __cplusplus
}
#endif

#endif /* BV_IMU_SOURCE_H_ */
