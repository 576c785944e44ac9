/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The chip model as the SPI bus shows it: what the datasheet says about registers, FIFO, interrupt
 * and turn-on. The values are written out here, not taken from the driver.
 */
#include <math.h>

#include <zephyr/drivers/gpio.h>
#include <zephyr/ztest.h>

#include "lsm6dsox_bus.h"
#include "model/model.h"
#include "sync_timer.h"

enum {
	FUNC_CFG_ACCESS = 0x01,
	FIFO_CTRL1 = 0x07,
	FIFO_CTRL2 = 0x08,
	FIFO_CTRL3 = 0x09,
	FIFO_CTRL4 = 0x0A,
	INT1_CTRL = 0x0D,
	WHO_AM_I = 0x0F,
	CTRL1_XL = 0x10,
	CTRL2_G = 0x11,
	CTRL3_C = 0x12,
	CTRL4_C = 0x13,
	CTRL5_C = 0x14,
	CTRL9_XL = 0x18,
	CTRL10_C = 0x19,
	WAKE_UP_SRC = 0x1B,
	STATUS_REG = 0x1E,
	OUT_TEMP_L = 0x20,
	OUTX_L_G = 0x22,
	OUTX_L_A = 0x28,
	OUTZ_L_A = 0x2C,
	FIFO_STATUS1 = 0x3A,
	TIMESTAMP0 = 0x40,
	TAP_CFG0 = 0x56,
	TAP_CFG2 = 0x58,
	WAKE_UP_THS = 0x5B,
	WAKE_UP_DUR = 0x5C,
	MD1_CFG = 0x5E,
	INTERNAL_FREQ_FINE = 0x63,
	FIFO_DATA_OUT_TAG = 0x78,
};

#define RATE_417_HZ    6U
#define RATE_417_US    2400U /* 16e6 / 6667 */
#define FIFO_WORDS     512U
#define MODE_BYPASS    0U
#define MODE_FIFO      1U
#define MODE_STREAM    6U
#define GRAVITY_MPS2   9.80665

static const struct spi_dt_spec spi = SPI_DT_SPEC_GET(
	DT_NODELABEL(imu), SPI_OP_MODE_MASTER | SPI_MODE_CPOL | SPI_MODE_CPHA | SPI_WORD_SET(8), 0);
static const struct gpio_dt_spec int1 = GPIO_DT_SPEC_GET(DT_NODELABEL(imu), int1_gpios);
static struct lsm6dsox_bus bus;
static uint32_t forbidden_before;

static const double flat[3] = {0.0, 0.0, GRAVITY_MPS2};
static const double still[3];

static uint8_t get(uint8_t address)
{
	const uint8_t *value;

	zassert_ok(lsm6dsox_bus_read(&bus, address, 1, &value));
	return *value;
}

static void put(uint8_t address, uint8_t value)
{
	zassert_ok(lsm6dsox_bus_write(&bus, address, &value, 1));
}

static int16_t get_axis(uint8_t address)
{
	const uint8_t *value;

	zassert_ok(lsm6dsox_bus_read(&bus, address, 2, &value));
	return (int16_t)(value[0] | value[1] << 8);
}

static uint16_t fifo_status(uint8_t *flags)
{
	const uint8_t *value;

	zassert_ok(lsm6dsox_bus_read(&bus, FIFO_STATUS1, 2, &value));
	*flags = value[1] & 0xF8;
	return (uint16_t)(value[0] | (value[1] & 3) << 8);
}

static uint16_t fifo_level(void)
{
	uint8_t flags;

	return fifo_status(&flags);
}

static const uint8_t *read_words(size_t words)
{
	const uint8_t *data;

	zassert_ok(lsm6dsox_bus_read(&bus, FIFO_DATA_OUT_TAG, 7 * words, &data));
	return data;
}

static uint32_t forbidden(void)
{
	return lsm6dsox_model_set_strict(false) - forbidden_before;
}

/* Both sensors at 417 Hz, 2 g, 250 dps, in the FIFO in @p mode with @p watermark words. */
static void start_fifo(uint8_t mode, uint16_t watermark)
{
	put(FIFO_CTRL1, watermark & 0xFF);
	put(FIFO_CTRL2, watermark >> 8);
	put(FIFO_CTRL3, RATE_417_HZ << 4 | RATE_417_HZ);
	put(CTRL2_G, RATE_417_HZ << 4);
	put(CTRL1_XL, RATE_417_HZ << 4);
	k_sleep(K_MSEC(100)); /* Until both have settled */
	put(FIFO_CTRL4, mode);
}

static void wait_slots(uint32_t slots)
{
	k_busy_wait(slots * RATE_417_US);
}

static void *set_up(void)
{
	zassert_ok(sync_timer_init());
	zassert_true(spi_is_ready_dt(&spi));
	zassert_ok(gpio_pin_configure_dt(&int1, GPIO_INPUT));
	lsm6dsox_bus_init(&bus, &spi);
	return NULL;
}

static void before(void *fixture)
{
	ARG_UNUSED(fixture);
	forbidden_before = lsm6dsox_model_set_strict(false);
	lsm6dsox_model_set_faults(NULL);
	lsm6dsox_model_set_clock(0.0, 0.0);
	lsm6dsox_model_set_pattern(false);
	lsm6dsox_model_set_motion(flat, still);
	put(FUNC_CFG_ACCESS, 0);
	put(CTRL3_C, 0x05);
	k_sleep(K_MSEC(1));
}

ZTEST_SUITE(lsm6dsox_emulator, NULL, set_up, before, NULL, NULL);

/* --- registers ------------------------------------------------------------------------------- */

ZTEST(lsm6dsox_emulator, test_identity_and_defaults)
{
	zexpect_equal(get(WHO_AM_I), 0x6C);
	zexpect_equal(get(CTRL3_C), 0x04);
	zexpect_equal(get(CTRL9_XL), 0xE0);
	zexpect_equal(get(FIFO_CTRL4), 0x00);
	zexpect_equal(get(INTERNAL_FREQ_FINE), 0x00);
	zexpect_equal(forbidden(), 0);
}

ZTEST(lsm6dsox_emulator, test_writes_are_remembered_until_reset)
{
	put(FIFO_CTRL1, 0xA5);
	put(WAKE_UP_THS, 0x15);
	zexpect_equal(get(FIFO_CTRL1), 0xA5);
	zexpect_equal(get(WAKE_UP_THS), 0x15);
	put(CTRL3_C, 0x05);
	zexpect_equal(get(CTRL3_C) & 1, 1, "the reset takes its time");
	k_sleep(K_MSEC(1));
	zexpect_equal(get(CTRL3_C), 0x04);
	zexpect_equal(get(FIFO_CTRL1), 0x00);
	zexpect_equal(forbidden(), 0);
}

ZTEST(lsm6dsox_emulator, test_wrong_writes_are_noticed)
{
	put(WHO_AM_I, 0x6C);
	zexpect_equal(forbidden(), 1, "read-only");
	put(0x03, 0x00);
	zexpect_equal(forbidden(), 2, "reserved register");
	put(CTRL10_C, 0x01);
	zexpect_equal(forbidden(), 3, "reserved bit");
	zexpect_equal(get(CTRL10_C), 0x00);
	put(FIFO_CTRL2, 0x40);
	zexpect_equal(forbidden(), 4, "compression is not modelled");
}

ZTEST(lsm6dsox_emulator, test_misprogrammed_fifo_is_noticed)
{
	put(FIFO_CTRL4, MODE_STREAM);
	zexpect_equal(forbidden(), 1, "nothing is batched");
	put(FIFO_CTRL4, MODE_BYPASS);
	put(CTRL1_XL, RATE_417_HZ << 4);
	put(FIFO_CTRL3, RATE_417_HZ + 1);
	put(FIFO_CTRL4, MODE_STREAM);
	zexpect_equal(forbidden(), 2, "batched faster than sampled");
	put(FIFO_CTRL3, RATE_417_HZ);
	put(INT1_CTRL, 0x08);
	zexpect_equal(forbidden(), 3, "watermark interrupt without watermark");
	put(FIFO_CTRL4, 5);
	zexpect_true(forbidden() > 3, "reserved mode");
}

ZTEST(lsm6dsox_emulator, test_without_auto_increment_a_burst_stays_where_it_is)
{
	const uint8_t *data;

	put(CTRL3_C, 0x00);
	zassert_ok(lsm6dsox_bus_read(&bus, WHO_AM_I, 3, &data));
	zexpect_equal(data[0], 0x6C);
	zexpect_equal(data[2], 0x6C);
}

ZTEST(lsm6dsox_emulator, test_other_banks_do_not_touch_the_user_bank)
{
	put(FUNC_CFG_ACCESS, 0x80);
	put(FIFO_CTRL1, 0x77);
	put(FUNC_CFG_ACCESS, 0x00);
	zexpect_equal(get(FIFO_CTRL1), 0x00);
}

/* --- samples --------------------------------------------------------------------------------- */

ZTEST(lsm6dsox_emulator, test_quantisation_and_full_scale)
{
	static const double moved[3] = {-GRAVITY_MPS2, 0.5 * GRAVITY_MPS2, 30.0};
	static const double turned[3] = {0.1, -1.0, 10.0};

	lsm6dsox_model_set_motion(moved, turned);
	put(CTRL2_G, RATE_417_HZ << 4);
	put(CTRL1_XL, RATE_417_HZ << 4);
	k_sleep(K_MSEC(100));
	/* 2 g: 0.061 mg per count; 250 dps: 8.75 mdps per count. */
	zexpect_equal(get_axis(OUTX_L_A), -16393);
	zexpect_equal(get_axis(OUTX_L_A + 2), 8197);
	zexpect_equal(get_axis(OUTZ_L_A), 32767, "30 m/s^2 is beyond 2 g");
	zexpect_equal(get_axis(OUTX_L_G), 655);
	zexpect_equal(get_axis(OUTX_L_G + 2), -6548);
	zexpect_equal(get_axis(OUTX_L_G + 4), 32767, "573 deg/s is beyond 250 deg/s");
	/* 16 g: 0.488 mg per count; 2000 dps: 70 mdps per count. */
	put(CTRL2_G, RATE_417_HZ << 4 | 0x0C);
	put(CTRL1_XL, RATE_417_HZ << 4 | 0x04);
	wait_slots(2);
	zexpect_equal(get_axis(OUTZ_L_A), 6269);
	zexpect_equal(get_axis(OUTX_L_G + 4), 8185);
}

ZTEST(lsm6dsox_emulator, test_data_ready_and_block_data_update)
{
	static const double falling[3] = {0.0, 0.0, -GRAVITY_MPS2};
	const uint8_t *data;
	uint8_t low;

	put(CTRL3_C, 0x44);
	put(CTRL1_XL, RATE_417_HZ << 4);
	k_sleep(K_MSEC(100));
	zexpect_equal(get(STATUS_REG) & 1, 1);
	low = get(OUTZ_L_A);
	lsm6dsox_model_set_motion(falling, still);
	wait_slots(2);
	/* The high byte is still that of the low byte read above. */
	zexpect_equal((int16_t)(low | get(OUTZ_L_A + 1) << 8), 16393);
	zexpect_equal(get(STATUS_REG) & 1, 0, "read, and not sampled since");
	zassert_ok(lsm6dsox_bus_read(&bus, OUTZ_L_A, 2, &data));
	zexpect_equal((int16_t)(data[0] | data[1] << 8), -16393);
	wait_slots(1);
	zexpect_equal(get(STATUS_REG) & 1, 1);
}

ZTEST(lsm6dsox_emulator, test_self_test_moves_the_output)
{
	int16_t change;

	put(CTRL1_XL, RATE_417_HZ << 4 | 0x08);
	k_sleep(K_MSEC(100));
	change = get_axis(OUTX_L_A);
	put(CTRL5_C, 0x01);
	wait_slots(2);
	change = get_axis(OUTX_L_A) - change;
	/* 4 g: 0.122 mg per count; 40 to 1700 mg are allowed. */
	zexpect_between_inclusive(change * 122 / 1000, 40, 1700);
}

ZTEST(lsm6dsox_emulator, test_temperature_and_timestamp)
{
	const uint8_t *data;
	uint32_t ticks;

	zexpect_equal(get_axis(OUT_TEMP_L), 0, "25 deg C");
	put(CTRL10_C, 0x20);
	k_busy_wait(100000);
	zassert_ok(lsm6dsox_bus_read(&bus, TIMESTAMP0, 4, &data));
	ticks = data[0] | data[1] << 8 | (uint32_t)data[2] << 16 | (uint32_t)data[3] << 24;
	zexpect_within(ticks, 100000 / 25, 2);
}

ZTEST(lsm6dsox_emulator, test_unsettled_samples_are_marked_when_asked)
{
	put(CTRL4_C, 0x08);
	start_fifo(MODE_BYPASS, 32);
	put(CTRL2_G, 0x00);
	put(CTRL2_G, RATE_417_HZ << 4);
	put(FIFO_CTRL4, MODE_STREAM);
	wait_slots(3);
	zexpect_true(fifo_level() >= 4);
	/* Gyroscope, just switched on: 7FFFh, 7FFEh, 7FFDh. */
	zexpect_mem_equal(&read_words(1)[1], "\xFF\x7F\xFE\x7F\xFD\x7F", 6);
}

/* --- FIFO ------------------------------------------------------------------------------------ */

ZTEST(lsm6dsox_emulator, test_fifo_words)
{
	const uint8_t *words;

	start_fifo(MODE_STREAM, 32);
	wait_slots(3);
	zexpect_equal(fifo_level(), 6);
	words = read_words(6);
	for (unsigned int i = 0; i < 6; i++) {
		const uint8_t tag = words[7 * i];

		zexpect_equal(tag >> 3, i % 2 == 0 ? 1 : 2, "gyroscope, then accelerometer");
		zexpect_equal(((tag >> 1) - (words[0] >> 1)) & 3, (i / 2) & 3, "slot counter");
		zexpect_equal(POPCOUNT(tag) & 1, 0, "parity");
	}
	/* z of the accelerometer: 1 g at 2 g full scale. */
	zexpect_equal((int16_t)(words[7 + 5] | words[7 + 6] << 8), 16393);
	zexpect_equal(fifo_level(), 0);
	zexpect_equal(read_words(1)[0], 0, "an empty FIFO has no tag");
}

ZTEST(lsm6dsox_emulator, test_watermark_and_int1)
{
	uint8_t flags;

	put(INT1_CTRL, 0x08);
	zexpect_equal(forbidden(), 0);
	start_fifo(MODE_STREAM, 4);
	wait_slots(1);
	zexpect_equal(gpio_pin_get_dt(&int1), 0);
	wait_slots(1);
	zexpect_equal(gpio_pin_get_dt(&int1), 1);
	zexpect_equal(fifo_status(&flags), 4);
	zexpect_equal(flags, 0x80);
	(void)read_words(1);
	zexpect_equal(gpio_pin_get_dt(&int1), 0, "below the watermark the pin falls");
	put(CTRL3_C, 0x24);
	zexpect_equal(gpio_pin_get_dt(&int1), 1, "active low when asked for");
}

ZTEST(lsm6dsox_emulator, test_continuous_mode_overwrites_the_oldest)
{
	uint8_t flags;
	uint8_t first;

	start_fifo(MODE_STREAM, 32);
	wait_slots(FIFO_WORDS / 2);
	zexpect_equal(fifo_status(&flags), FIFO_WORDS);
	zexpect_equal(flags & 0x48, 0, "full is not overrun");
	wait_slots(3);
	zexpect_equal(fifo_status(&flags), FIFO_WORDS);
	zexpect_equal(flags & 0x48, 0x48);
	(void)fifo_status(&flags);
	zexpect_equal(flags & 0x08, 0, "the latch is cleared by reading");
	first = read_words(1)[0];
	zexpect_equal(first >> 3, 1, "whole slots have gone");
	(void)fifo_status(&flags);
	zexpect_equal(flags & 0x40, 0);
}

ZTEST(lsm6dsox_emulator, test_fifo_mode_stops_when_full)
{
	uint8_t flags;
	uint8_t tag;

	start_fifo(MODE_FIFO, 32);
	wait_slots(FIFO_WORDS / 2 + 10);
	zexpect_equal(fifo_status(&flags), FIFO_WORDS);
	zexpect_equal(flags & 0x48, 0);
	tag = read_words(2)[0];
	wait_slots(2);
	zexpect_equal(((read_words(1)[0] >> 1) - (tag >> 1)) & 3, 1, "the oldest are still there");
}

ZTEST(lsm6dsox_emulator, test_bypass_empties_and_stays_empty)
{
	start_fifo(MODE_STREAM, 32);
	wait_slots(5);
	put(FIFO_CTRL4, MODE_BYPASS);
	zexpect_equal(fifo_level(), 0);
	wait_slots(5);
	zexpect_equal(fifo_level(), 0);
}

ZTEST(lsm6dsox_emulator, test_stop_on_watermark_limits_the_depth)
{
	put(FIFO_CTRL2, 0x80);
	put(FIFO_CTRL1, 8);
	put(FIFO_CTRL3, RATE_417_HZ << 4 | RATE_417_HZ);
	put(CTRL2_G, RATE_417_HZ << 4);
	put(CTRL1_XL, RATE_417_HZ << 4);
	put(FIFO_CTRL4, MODE_FIFO);
	wait_slots(20);
	zexpect_equal(fifo_level(), 8);
}

ZTEST(lsm6dsox_emulator, test_different_batching_rates)
{
	const uint8_t *words;

	put(FIFO_CTRL3, (RATE_417_HZ - 1) << 4 | RATE_417_HZ);
	put(CTRL2_G, RATE_417_HZ << 4);
	put(CTRL1_XL, RATE_417_HZ << 4);
	put(FIFO_CTRL4, MODE_STREAM);
	wait_slots(4);
	zexpect_equal(fifo_level(), 6);
	words = read_words(6);
	zexpect_equal(words[0] >> 3, 1);
	zexpect_equal(words[7] >> 3, 2);
	zexpect_equal(words[14] >> 3, 2, "every second slot is without the gyroscope");
	zexpect_equal(words[21] >> 3, 1);
}

ZTEST(lsm6dsox_emulator, test_config_change_puts_a_word)
{
	start_fifo(MODE_BYPASS, 32);
	put(FIFO_CTRL2, 0x10);
	put(FIFO_CTRL4, MODE_STREAM);
	wait_slots(1);
	put(CTRL1_XL, RATE_417_HZ << 4 | 0x04);
	wait_slots(1);
	zexpect_equal(fifo_level(), 5);
	zexpect_equal(read_words(3)[14] >> 3, 5);
}

ZTEST(lsm6dsox_emulator, test_timestamp_words)
{
	put(CTRL10_C, 0x20);
	start_fifo(MODE_BYPASS, 32);
	put(FIFO_CTRL4, MODE_STREAM | 1 << 6);
	wait_slots(2);
	zexpect_equal(fifo_level(), 6);
	zexpect_equal(read_words(3)[14] >> 3, 4);
}

ZTEST(lsm6dsox_emulator, test_words_arrive_while_a_burst_is_read)
{
	start_fifo(MODE_STREAM, 32);
	wait_slots(31);
	/* 62 words take 436 us at 8 MHz, and a slot 2400 us: at most one comes in between. */
	(void)read_words(62);
	zexpect_between_inclusive(fifo_level(), 0, 2);
}

/* --- clock ----------------------------------------------------------------------------------- */

ZTEST(lsm6dsox_emulator, test_rate_error_shows_in_rate_and_trim)
{
	uint16_t level;

	lsm6dsox_model_set_clock(-0.068, 0.0);
	put(CTRL3_C, 0x05);
	k_sleep(K_MSEC(1));
	zexpect_equal((int8_t)get(INTERNAL_FREQ_FINE), -45, "steps of 0.15 %%");
	start_fifo(MODE_STREAM, 32);
	k_busy_wait(500000);
	level = fifo_level();
	/* 416.7 Hz less 6.8 %, two words each. */
	zexpect_within(level, 388, 3);
}

/* --- wake-up --------------------------------------------------------------------------------- */

ZTEST(lsm6dsox_emulator, test_wake_up_interrupt)
{
	static const double nudged[3] = {0.0, 1.0, GRAVITY_MPS2};
	static const double lifted[3] = {0.0, 1.0, 14.0};

	put(CTRL1_XL, 0x30);    /* 52 Hz, 2 g */
	put(WAKE_UP_THS, 0x10); /* 16 / 256 of 2 g: 125 mg */
	put(WAKE_UP_DUR, 0x10);
	put(TAP_CFG0, 0x41);
	put(TAP_CFG2, 0x80);
	put(MD1_CFG, 0x20);
	k_sleep(K_MSEC(100));
	zexpect_equal(gpio_pin_get_dt(&int1), 0);
	lsm6dsox_model_set_motion(nudged, still);
	k_sleep(K_MSEC(100));
	zexpect_equal(gpio_pin_get_dt(&int1), 0, "half of 102 mg is below the threshold");
	lsm6dsox_model_set_motion(lifted, still);
	k_sleep(K_MSEC(100));
	zexpect_equal(gpio_pin_get_dt(&int1), 1);
	zexpect_equal(get(WAKE_UP_SRC), 0x09, "wake-up, z");
	zexpect_equal(gpio_pin_get_dt(&int1), 0, "latched until it is read");
	zexpect_equal(forbidden(), 0);
}

/* --- faults ---------------------------------------------------------------------------------- */

ZTEST(lsm6dsox_emulator, test_faults)
{
	lsm6dsox_model_set_faults("wrong_who_am_i");
	zexpect_equal(get(WHO_AM_I), 0x6A);
	lsm6dsox_model_set_faults("stuck_bus:0:0:1");
	zexpect_equal(get(WHO_AM_I), 0xFF);
	lsm6dsox_model_set_faults("stuck_bus:0:0:0");
	put(FIFO_CTRL1, 0x12);
	zexpect_equal(get(WHO_AM_I), 0x00);
	lsm6dsox_model_set_faults("bit_errors:0:0:1");
	zexpect_equal(get(WHO_AM_I), 0x93);
	lsm6dsox_model_set_faults("stuck_bus:1");
	zexpect_equal(get(WHO_AM_I), 0x6C, "not yet");
	zexpect_equal(get(FIFO_CTRL1), 0x00, "the write did not arrive");
	lsm6dsox_model_set_faults("missing_int");
	put(INT1_CTRL, 0x08);
	start_fifo(MODE_STREAM, 4);
	wait_slots(3);
	zexpect_equal(gpio_pin_get_dt(&int1), 0);
	lsm6dsox_model_set_faults(NULL);
	zexpect_equal(gpio_pin_get_dt(&int1), 1);
}
