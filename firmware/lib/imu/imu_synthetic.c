/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A sensor that does not exist: the bar goes up and down once in two seconds and rocks a little.
 *
 * Sample n is taken at t0 + n * period of this node's sync clock, exactly, and its value depends
 * on n alone, so a reader of the stream can recompute every sample. Sensor axes: z up, at rest
 * +1 g on z.
 */
#include "imu_source.h"

#include <errno.h>
#include <math.h>

#include <zephyr/kernel.h>

#include "sync_timer.h"

#define RATE_HZ 416U
/* 16e6 / 416 ticks, in 1/256 tick: 9846153.8, so the true rate is 416.0000 Hz to 2e-8. */
#define PERIOD_SUBTICKS ((uint32_t)((16000000ULL * 256U + RATE_HZ / 2U) / RATE_HZ))

#define ACCEL_FS_G          16U
#define GYRO_FS_DPS         2000U
#define ACCEL_LSB_PER_G     (1.0f / 0.488e-3f) /* LSM6DSOX, +-16 g */
#define GYRO_LSB_PER_DPS    (1.0f / 70e-3f)    /* LSM6DSOX, +-2000 dps */
#define TEMPERATURE_CDEGC   2500

#define STROKE_PERIOD_SAMPLES (2U * RATE_HZ)
#define STROKE_ACCEL_G        0.5f
#define ROCK_RATE_DPS         20.0f
#define TWO_PI                6.2831853f

static imu_source_batch_cb batch_cb;
static uint64_t start_ticks;
static uint32_t next_sample;
static volatile bool running;

static K_SEM_DEFINE(started, 0, 1);

static uint64_t sample_ticks(uint32_t index)
{
	return start_ticks + (uint64_t)index * PERIOD_SUBTICKS / 256U;
}

static void make_sample(uint32_t index, struct wire_imu_batch_samples *sample)
{
	float phase = TWO_PI * (float)(index % STROKE_PERIOD_SAMPLES) / (float)STROKE_PERIOD_SAMPLES;
	float vertical_g = 1.0f + STROKE_ACCEL_G * sinf(phase);
	float roll_dps = ROCK_RATE_DPS * cosf(phase);

	sample->gyro_lsb[0] = (int16_t)lrintf(roll_dps * GYRO_LSB_PER_DPS);
	sample->gyro_lsb[1] = 0;
	sample->gyro_lsb[2] = 0;
	sample->accel_lsb[0] = 0;
	sample->accel_lsb[1] = 0;
	sample->accel_lsb[2] = (int16_t)lrintf(vertical_g * ACCEL_LSB_PER_G);
}

static void deliver_batch(void)
{
	static struct wire_imu_batch batch = {
		.flags = WIRE_IMU_FLAG_SYNTHETIC | WIRE_IMU_FLAG_HARDWARE_TIME,
		.accel_fs_g = ACCEL_FS_G,
		.gyro_fs_dps = GYRO_FS_DPS,
		.period_ticks = PERIOD_SUBTICKS,
		.temperature_cdegc = TEMPERATURE_CDEGC,
		.count = CONFIG_BV_IMU_BATCH,
	};

	batch.sample_index = next_sample;
	batch.t_first_ticks_node = sample_ticks(next_sample);
	for (uint8_t i = 0; i < batch.count; i++) {
		make_sample(next_sample + i, &batch.samples[i]);
	}
	next_sample += batch.count;
	batch_cb(&batch);
}

static void wait_until(uint64_t t_ticks)
{
	uint64_t now_ticks = sync_timer_now_ticks();

	if (t_ticks > now_ticks) {
		k_sleep(K_USEC((t_ticks - now_ticks) / SYNC_TICKS_PER_US));
	}
}

static void imu_thread(void *p1, void *p2, void *p3)
{
	ARG_UNUSED(p1);
	ARG_UNUSED(p2);
	ARG_UNUSED(p3);
	for (;;) {
		(void)k_sem_take(&started, K_FOREVER);
		while (running) {
			/* A batch is there when its last sample has been taken. */
			wait_until(sample_ticks(next_sample + CONFIG_BV_IMU_BATCH - 1U));
			deliver_batch();
		}
	}
}

K_THREAD_DEFINE(bv_imu, CONFIG_BV_IMU_STACK_SIZE, imu_thread, NULL, NULL, NULL,
		K_PRIO_PREEMPT(4), 0, 0);

int imu_source_start(imu_source_batch_cb on_batch)
{
	if (running) {
		return -EALREADY;
	}
	batch_cb = on_batch;
	next_sample = 0;
	start_ticks = sync_timer_now_ticks();
	running = true;
	k_sem_give(&started);
	return 0;
}

void imu_source_stop(void)
{
	running = false;
}
