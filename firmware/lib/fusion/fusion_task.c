/* SPDX-License-Identifier: Apache-2.0 */
#include "fusion_task.h"

#include <zephyr/kernel.h>

#include "diag_report.h"
#include "fusion_frames.h"
#include "node.h"
#include "watchdog.h"

K_MSGQ_DEFINE(batches, sizeof(struct wire_imu_batch), CONFIG_BV_FUSION_QUEUE_DEPTH, 8);

/* The stream and the queue get every batch in the same order. */
static K_MUTEX_DEFINE(order_lock);

static void fusion_thread(void *p1, void *p2, void *p3)
{
	static struct wire_imu_batch batch;

	ARG_UNUSED(p1);
	ARG_UNUSED(p2);
	ARG_UNUSED(p3);
	for (;;) {
		(void)k_msgq_get(&batches, &batch, K_FOREVER);
		watchdog_begin(WATCHDOG_FUSION);
		fusion_frames_take(&batch);
		watchdog_end(WATCHDOG_FUSION);
	}
}

/* Below everything that has a deadline: a late estimate costs nothing but latency. */
K_THREAD_DEFINE(bv_fusion, CONFIG_BV_FUSION_STACK_SIZE, fusion_thread, NULL, NULL, NULL,
		K_PRIO_PREEMPT(6), K_FP_REGS, 0);

void fusion_take(const struct wire_imu_batch *batch)
{
	static uint32_t overruns;
	bool taken = true;

	(void)k_mutex_lock(&order_lock, K_FOREVER);
	node_send_batch(batch);
	/* The estimator gets what a calibration has made right, of either node, or nothing. */
	if ((batch->flags & WIRE_IMU_FLAG_UNCORRECTED) == 0U) {
		taken = k_msgq_put(&batches, batch, K_NO_WAIT) == 0;
	}
	overruns += taken ? 0U : 1U;
	/* At powers of two: a node that is too slow must not fill the line with faults. */
	if (!taken && (overruns & (overruns - 1U)) == 0U) {
		diag_report_fault(WIRE_FAULT_CODE_FUSION_OVERRUN, overruns,
				  "estimator is too slow: IMU batches dropped");
	}
	(void)k_mutex_unlock(&order_lock);
}
