/* SPDX-License-Identifier: Apache-2.0 */
#include "lsm6dsox_config.h"

#include <errno.h>
#include <math.h>
#include <string.h>

#include <zephyr/kernel.h>
#include <zephyr/sys/util.h>

#define TOP_RATE_HZ    6667.0f
#define TOP_RATE_CODE  10U
#define FREQ_FINE_STEP 0.0015f

#define RESET_POLL_US    100U
#define RESET_POLLS_MAX  50U

/* While waiting for motion: half the change of 1/256 of 2 g is one step of the threshold. */
#define WAKE_CHANGE_MG_PER_256_STEPS (2U * 2000U)

/* Three samples: the first ones after the accelerometer was switched on are not settled, and their
 * change would count as motion.
 */
#define WAKE_SETTLE_MS 60

struct setting {
	uint8_t address;
	uint8_t value;
};

/* The value of a register whose bits are given by ST's definition of it. */
#define REGISTER(address_, type, ...)                                                              \
	{                                                                                          \
		address_, value_of(&(const type){__VA_ARGS__})                                     \
	}

static uint8_t value_of(const void *bits)
{
	uint8_t value;

	/* ST's types are bit fields of one byte. */
	memcpy(&value, bits, sizeof(value));
	return value;
}

uint8_t lsm6dsox_rate_code(uint32_t rate_hz)
{
	const float octaves = log2f(TOP_RATE_HZ / (float)MAX(rate_hz, 1U));

	return (uint8_t)((int)TOP_RATE_CODE -
			 CLAMP((int)lrintf(octaves), 0, (int)TOP_RATE_CODE - 1));
}

float lsm6dsox_rate_hz(uint8_t rate_code, int8_t freq_fine)
{
	return ldexpf(TOP_RATE_HZ * (1.0f + FREQ_FINE_STEP * (float)freq_fine),
		      (int)rate_code - (int)TOP_RATE_CODE);
}

static uint8_t accel_fs_bits(uint8_t full_scale_g)
{
	switch (full_scale_g) {
	case 2:
		return LSM6DSOX_2g;
	case 4:
		return LSM6DSOX_4g;
	case 8:
		return LSM6DSOX_8g;
	default:
		return LSM6DSOX_16g;
	}
}

static uint8_t gyro_fs_bits(uint16_t full_scale_dps)
{
	switch (full_scale_dps) {
	case 125:
		return LSM6DSOX_125dps;
	case 250:
		return LSM6DSOX_250dps;
	case 500:
		return LSM6DSOX_500dps;
	case 1000:
		return LSM6DSOX_1000dps;
	default:
		return LSM6DSOX_2000dps;
	}
}

static int write_setting(struct lsm6dsox_bus *bus, const struct setting *setting)
{
	return lsm6dsox_bus_write(bus, setting->address, &setting->value, 1U);
}

static int check_setting(struct lsm6dsox_bus *bus, const struct setting *setting)
{
	const uint8_t *value;
	const int err = lsm6dsox_bus_read(bus, setting->address, 1U, &value);

	if (err) {
		return err;
	}
	return *value == setting->value ? 0 : -EIO;
}

static int each(struct lsm6dsox_bus *bus, const struct setting *settings, size_t count,
		int (*act)(struct lsm6dsox_bus *bus, const struct setting *setting))
{
	for (size_t i = 0; i < count; i++) {
		const int err = act(bus, &settings[i]);

		if (err) {
			return err;
		}
	}
	return 0;
}

/* Mode of the bus, and of the sensors, in which this driver always runs. */
#define COMMON_SETTINGS                                                                            \
	REGISTER(LSM6DSOX_CTRL3_C, lsm6dsox_ctrl3_c_t, .bdu = 1, .if_inc = 1),                     \
		REGISTER(LSM6DSOX_CTRL4_C, lsm6dsox_ctrl4_c_t, .drdy_mask = 1, .i2c_disable = 1),  \
		REGISTER(LSM6DSOX_CTRL9_XL, lsm6dsox_ctrl9_xl_t, .i3c_disable = 1, .den_x = 1,     \
			 .den_y = 1, .den_z = 1)

#define STREAM_SETTINGS_COUNT 10U

static void stream_settings(const struct lsm6dsox_settings *s,
			    struct setting settings[STREAM_SETTINGS_COUNT])
{
	const struct setting list[STREAM_SETTINGS_COUNT] = {
		COMMON_SETTINGS,
		REGISTER(LSM6DSOX_FIFO_CTRL1, lsm6dsox_fifo_ctrl1_t,
			 .wtm = (uint8_t)(s->watermark_words & 0xFFU)),
		REGISTER(LSM6DSOX_FIFO_CTRL2, lsm6dsox_fifo_ctrl2_t,
			 .wtm = (s->watermark_words >> 8) & 1U, .odrchg_en = 1),
		REGISTER(LSM6DSOX_FIFO_CTRL3, lsm6dsox_fifo_ctrl3_t, .bdr_xl = s->rate_code & 0xFU,
			 .bdr_gy = s->rate_code & 0xFU),
		REGISTER(LSM6DSOX_INT1_CTRL, lsm6dsox_int1_ctrl_t, .int1_fifo_th = 1),
		REGISTER(LSM6DSOX_CTRL2_G, lsm6dsox_ctrl2_g_t, .odr_g = s->rate_code & 0xFU,
			 .fs_g = gyro_fs_bits(s->gyro_fs_dps) & 7U),
		REGISTER(LSM6DSOX_CTRL1_XL, lsm6dsox_ctrl1_xl_t, .odr_xl = s->rate_code & 0xFU,
			 .fs_xl = accel_fs_bits(s->accel_fs_g) & 3U),
		/* Last: the FIFO starts with both sensors running, on a slot's first word. */
		REGISTER(LSM6DSOX_FIFO_CTRL4, lsm6dsox_fifo_ctrl4_t,
			 .fifo_mode = LSM6DSOX_STREAM_MODE),
	};

	memcpy(settings, list, sizeof(list));
}

int lsm6dsox_config_identify(struct lsm6dsox_bus *bus, uint8_t *who_am_i)
{
	int err = lsm6dsox_device_id_get(&bus->registers, who_am_i);

	if (!err && *who_am_i != LSM6DSOX_ID) {
		err = -ENODEV;
	}
	return err;
}

int lsm6dsox_config_reset(struct lsm6dsox_bus *bus)
{
	const struct setting user_bank = {LSM6DSOX_FUNC_CFG_ACCESS, 0};
	const struct setting reset =
		REGISTER(LSM6DSOX_CTRL3_C, lsm6dsox_ctrl3_c_t, .sw_reset = 1, .if_inc = 1);
	int err = write_setting(bus, &user_bank);

	if (!err) {
		err = write_setting(bus, &reset);
	}
	for (uint32_t i = 0; !err && i < RESET_POLLS_MAX; i++) {
		uint8_t busy;

		k_usleep(RESET_POLL_US);
		err = lsm6dsox_reset_get(&bus->registers, &busy);
		if (!err && !busy) {
			return 0;
		}
	}
	return err ? err : -ETIMEDOUT;
}

int lsm6dsox_config_stream(struct lsm6dsox_bus *bus, const struct lsm6dsox_settings *s)
{
	struct setting settings[STREAM_SETTINGS_COUNT];
	int err;

	stream_settings(s, settings);
	err = each(bus, settings, ARRAY_SIZE(settings), write_setting);
	return err ? err : each(bus, settings, ARRAY_SIZE(settings), check_setting);
}

int lsm6dsox_config_check_stream(struct lsm6dsox_bus *bus, const struct lsm6dsox_settings *s)
{
	struct setting settings[STREAM_SETTINGS_COUNT];

	stream_settings(s, settings);
	return each(bus, settings, ARRAY_SIZE(settings), check_setting);
}

int lsm6dsox_config_wake(struct lsm6dsox_bus *bus, const struct lsm6dsox_settings *s)
{
	const struct setting settings[] = {
		COMMON_SETTINGS,
		/* Low power: the accelerometer alone, out of high-performance mode. */
		REGISTER(LSM6DSOX_CTRL6_C, lsm6dsox_ctrl6_c_t, .xl_hm_mode = 1),
		REGISTER(LSM6DSOX_WAKE_UP_THS, lsm6dsox_wake_up_ths_t,
			 .wk_ths = CLAMP(256U * s->wake_mg / WAKE_CHANGE_MG_PER_256_STEPS,
						  1U, 63U) & 0x3FU),
		REGISTER(LSM6DSOX_WAKE_UP_DUR, lsm6dsox_wake_up_dur_t, .wake_ths_w = 1),
		/* Latched, so that a short event is not missed; read WAKE_UP_SRC to release. */
		REGISTER(LSM6DSOX_TAP_CFG0, lsm6dsox_tap_cfg0_t, .lir = 1, .int_clr_on_read = 1),
		REGISTER(LSM6DSOX_CTRL1_XL, lsm6dsox_ctrl1_xl_t, .odr_xl = LSM6DSOX_XL_ODR_52Hz,
			 .fs_xl = LSM6DSOX_2g),
		REGISTER(LSM6DSOX_MD1_CFG, lsm6dsox_md1_cfg_t, .int1_wu = 1),
	};
	const struct setting enable =
		REGISTER(LSM6DSOX_TAP_CFG2, lsm6dsox_tap_cfg2_t, .interrupts_enable = 1);
	int err = each(bus, settings, ARRAY_SIZE(settings), write_setting);

	err = err ? err : each(bus, settings, ARRAY_SIZE(settings), check_setting);
	if (err) {
		return err;
	}
	k_msleep(WAKE_SETTLE_MS);
	err = write_setting(bus, &enable);
	return err ? err : check_setting(bus, &enable);
}

int lsm6dsox_config_has_woken(struct lsm6dsox_bus *bus, bool *woken)
{
	lsm6dsox_wake_up_src_t source;
	const int err = lsm6dsox_read_reg(&bus->registers, LSM6DSOX_WAKE_UP_SRC,
					  (uint8_t *)&source, sizeof(source));

	*woken = !err && source.wu_ia != 0U;
	return err;
}

int lsm6dsox_config_freq_fine(struct lsm6dsox_bus *bus, int8_t *freq_fine)
{
	return lsm6dsox_odr_cal_reg_get(&bus->registers, (uint8_t *)freq_fine);
}

int lsm6dsox_config_temperature(struct lsm6dsox_bus *bus, int16_t *temperature_cdegc)
{
	int16_t raw;
	const int err = lsm6dsox_temperature_raw_get(&bus->registers, &raw);

	if (!err) {
		*temperature_cdegc =
			(int16_t)lrintf(100.0f * lsm6dsox_from_lsb_to_celsius(raw));
	}
	return err;
}
