/* SPDX-License-Identifier: Apache-2.0 */
#include "diag_csv.h"

#include <inttypes.h>
#include <stdbool.h>

#include <zephyr/sys/printk.h>
#include <zephyr/sys/util.h>

#include "diag_uart.h"
#include "lsm6dsox_scale.h"
#include "shadow_log.h"
#include "sync_timer.h"

#define NODE (IS_ENABLED(CONFIG_BV_ROLE_LEADER) ? "leader" : "follower")

#define IMU_LINE_PERIOD_US 100000U

/* One subtick is 1/256 of 62.5 ns. */
#define NS_PER_SUBTICK_NUM 625
#define NS_PER_SUBTICK_DEN 2560

static const char *const state_names[] = {"unsynced", "converging", "locked", "holdover"};

void diag_csv_header(void)
{
	diag_uart_line("#IMU,node,t_us,gyro_x_mdps,gyro_y_mdps,gyro_z_mdps,"
		       "accel_x_mg,accel_y_mg,accel_z_mg");
	diag_uart_line("#SYNC,node,t_us,state,offset_ns,skew_ppb,residual_rms_ns,"
		       "offset_sigma_ns,pairs_used,pairs_dropped");
	if (IS_ENABLED(CONFIG_BV_SHADOW_LOG)) {
		diag_uart_line(SHADOW_HEADER);
	}
}

static int32_t gyro_mdps(const struct wire_imu_batch *batch, int axis)
{
	return (int32_t)((int64_t)batch->samples[0].gyro_lsb[axis] * batch->gyro_fs_dps *
			 LSM6DSOX_GYRO_UDPS_PER_LSB_PER_DPS / 1000);
}

static int32_t accel_mg(const struct wire_imu_batch *batch, int axis)
{
	return (int32_t)batch->samples[0].accel_lsb[axis] * batch->accel_fs_g *
	       LSM6DSOX_ACCEL_UG_PER_2_LSB_PER_G / 2000;
}

void diag_csv_imu(const struct wire_imu_batch *batch)
{
	static uint64_t next_us;
	uint64_t t_us = batch->t_first_ticks_node / SYNC_TICKS_PER_US;
	char line[128];

	if (batch->count == 0U || t_us < next_us) {
		return;
	}
	next_us = t_us - t_us % IMU_LINE_PERIOD_US + IMU_LINE_PERIOD_US;
	snprintk(line, sizeof(line),
		 "IMU,%s,%" PRIu64 ",%" PRId32 ",%" PRId32 ",%" PRId32 ",%" PRId32 ",%" PRId32
		 ",%" PRId32,
		 NODE, t_us, gyro_mdps(batch, 0), gyro_mdps(batch, 1), gyro_mdps(batch, 2),
		 accel_mg(batch, 0), accel_mg(batch, 1), accel_mg(batch, 2));
	diag_uart_line(line);
}

static int64_t subticks_to_ns(int64_t subticks)
{
	/* Whole ticks apart: an offset of days would overflow the product. */
	return subticks / 256 * 125 / 2 + subticks % 256 * NS_PER_SUBTICK_NUM / NS_PER_SUBTICK_DEN;
}

void diag_csv_sync(const struct wire_sync_state *state)
{
	char line[160];

	snprintk(line, sizeof(line),
		 "SYNC,%s,%" PRIu64 ",%s,%" PRId64 ",%" PRId32 ",%" PRId64 ",%" PRId64 ",%u,%" PRIu32,
		 NODE, sync_timer_now_ticks() / SYNC_TICKS_PER_US,
		 state->state < ARRAY_SIZE(state_names) ? state_names[state->state] : "invalid",
		 subticks_to_ns(state->offset_ticks), state->skew / 1000,
		 subticks_to_ns(state->residual_rms_ticks),
		 subticks_to_ns(state->offset_sigma_ticks), state->pairs_used,
		 state->pairs_dropped);
	diag_uart_line(line);
}
