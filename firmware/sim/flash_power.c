/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The power of the simulated board's flash: it can fail at any operation.
 *
 *   -hil_flash_log=FILE     one line for each operation: "number,local us,write|erase,address,value"
 *   -hil_flash_cut=N:HOW    the power fails at operation N (from 1); HOW says how far it had come:
 *                           before - not begun; torn - half of its bits; after - complete
 *
 * A program that lost its power ends at once with exit status 86; what was in the flash stays in
 * the file of the stock option -flash.
 */
#include "bs_cmd_line.h"
#include "bs_dynargs.h"
#include "bs_tracing.h"
#include "bs_types.h"
#include "nsi_hws_models_if.h"
#include "nsi_tasks.h"

#include "NHW_NVMC.h"
#include "NHW_peri_types.h"

#include <errno.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

/* Of the hardware models; their headers do not declare it. */
extern NRF_NVMC_Type NRF_NVMC_regs[];

#define EXIT_POWER_CUT 86
#define PAGE_SIZE_B    4096U
/* Half of a word's bits: those that a write had reached, those that an erase had. */
#define TORN_BITS      0x5555A5A5U

void __real_nhw_nmvc_write_word(uint32_t address, uint32_t value);
void __real_nhw_nvmc_regw_sideeffects_ERASEPAGE(unsigned int inst);

static struct {
	char *log_path;
	char *cut_text;
	FILE *log;
	unsigned long operations;
	unsigned long cut_at; /* 0: never */
	enum { BEFORE, TORN, AFTER } how;
} power;

static void count(const char *what, uint32_t address, uint32_t value)
{
	power.operations++;
	if (power.log != NULL) {
		fprintf(power.log, "%lu,%llu,%s,%u,%u\n", power.operations,
			(unsigned long long)nsi_hws_get_time(), what, address, value);
		fflush(power.log);
	}
}

static bool fails(int how)
{
	return power.operations == power.cut_at && power.how == how;
}

static _Noreturn void cut(void)
{
	/* No exit handler runs, and nothing is flushed: the power is gone. */
	_exit(EXIT_POWER_CUT);
}

void __wrap_nhw_nmvc_write_word(uint32_t address, uint32_t value)
{
	count("write", address, value);
	if (fails(BEFORE)) {
		cut();
	}
	if (fails(TORN)) {
		/* A write only clears bits. */
		__real_nhw_nmvc_write_word(address, value | TORN_BITS);
		cut();
	}
	__real_nhw_nmvc_write_word(address, value);
	if (fails(AFTER)) {
		cut();
	}
}

static void set_bits(uint8_t *page, uint32_t bits)
{
	for (size_t i = 0; i < PAGE_SIZE_B; i++) {
		page[i] |= (uint8_t)(bits >> (8U * (i % 4U)));
	}
}

void __wrap_nhw_nvmc_regw_sideeffects_ERASEPAGE(unsigned int inst)
{
	const uint32_t address = NRF_NVMC_regs[inst].ERASEPAGE;
	/* The model gives the address of its pointer to the flash. */
	uint8_t *page = *(uint8_t **)nrfhw_nmvc_flash_get_base_address(inst) + address;

	count("erase", address, 0);
	if (fails(BEFORE)) {
		cut();
	}
	if (fails(TORN)) {
		set_bits(page, TORN_BITS);
		cut();
	}
	if (fails(AFTER)) {
		set_bits(page, UINT32_MAX);
		cut();
	}
	__real_nhw_nvmc_regw_sideeffects_ERASEPAGE(inst);
}

static void cut_found(char *argv, int offset)
{
	static const char *const words[] = {"before", "torn", "after"};
	char how[8] = "";

	(void)offset;
	if (sscanf(power.cut_text, "%lu:%7s", &power.cut_at, how) == 2 && power.cut_at > 0) {
		for (int i = 0; i < 3; i++) {
			if (strcmp(how, words[i]) == 0) {
				power.how = i;
				return;
			}
		}
	}
	bs_trace_error_line("%s: a number from 1 and before, torn or after are needed\n", argv);
}

static void flash_power_init(void)
{
	if (power.log_path != NULL) {
		power.log = fopen(power.log_path, "w");
		if (power.log == NULL) {
			bs_trace_error_line("%s: %s\n", power.log_path, strerror(errno));
		}
	}
}

NSI_TASK(flash_power_init, HW_INIT, 100);

static void flash_power_register_options(void)
{
	static bs_args_struct_t options[] = {
		{
			.option = "hil_flash_log",
			.name = "file",
			.type = 's',
			.dest = (void *)&power.log_path,
			.descript = "Write each operation on the flash to this file",
		},
		{
			.option = "hil_flash_cut",
			.name = "N:before|torn|after",
			.type = 's',
			.dest = (void *)&power.cut_text,
			.call_when_found = cut_found,
			.descript = "The power fails at the N-th operation on the flash",
		},
		ARG_TABLE_ENDMARKER,
	};

	bs_add_extra_dynargs(options);
}

NSI_TASK(flash_power_register_options, PRE_BOOT_1, 200);
