/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * The calibration in force on this node: from flash or from Kconfig, with the gyroscope's bias of
 * this boot; applied to each batch before anyone else gets it.
 *
 * Until the boot check has decided, batches leave as the sensor made them and say so.
 */
#ifndef BV_CALIB_H_
#define BV_CALIB_H_

#include <stdbool.h>
#include <stdint.h>

#include "wire.h"

#ifdef __cplusplus
extern "C" {
#endif

/**
 * Load the record of the node @p device_id and begin the boot check. Before the IMU starts, and
 * before Bluetooth, for the flash may have to be cleared.
 */
void cal_init(uint64_t device_id);

/** Whether the boot check has decided. */
bool cal_ready(void);

/** The samples start anew: drop the window of the boot check. A decision made stays. */
void cal_restart(void);

/**
 * Correct @p batch in place, or flag it as uncorrected. In the thread that makes the batches; what
 * the boot check decides is reported from there.
 */
void cal_take(struct wire_imu_batch *batch);

/** Send CAL status on the diagnostic stream. */
void cal_report(void);

/**
 * Store @p record and put it in force; answer with CAL record, as the store holds it, and status.
 *
 * In the system work queue, as cal_command().
 *
 * @return 0; -EAGAIN before cal_init() is done; -EINVAL when it is impossible or another node's;
 *         -ENOTSUP without a store; or a negative errno of the store. Then nothing changes.
 */
int cal_take_record(const struct wire_cal_record *record);

/**
 * WIRE_NODE_COMMAND_CAL_READ: answer with CAL record, or with status and why there is none;
 * _CAL_ERASE: forget the record; _RAW_ON, _RAW_OFF: switch the correction off and on. These answer
 * with status.
 *
 * @return 0; -EAGAIN before cal_init() is done; -EINVAL for other commands; or a negative errno of
 *         the store.
 */
int cal_command(uint8_t command);

#ifdef __cplusplus
}
#endif

#endif /* BV_CALIB_H_ */
