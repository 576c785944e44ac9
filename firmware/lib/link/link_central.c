/* SPDX-License-Identifier: Apache-2.0 */
#include <errno.h>
#include <string.h>

#include <zephyr/bluetooth/bluetooth.h>
#include <zephyr/bluetooth/gatt.h>
#include <zephyr/kernel.h>

#include "link.h"
#include "link_role.h"
#include "link_security.h"

/* ATT itself gives up after 30 s; a link that takes this long is started over. */
#define STEP_TIMEOUT K_SECONDS(5)

static const struct bt_uuid_128 service_uuid = BT_UUID_INIT_128(LINK_UUID_SERVICE_VAL);
static const struct bt_uuid_128 to_leader_uuid = BT_UUID_INIT_128(LINK_UUID_TO_LEADER_VAL);
static const struct bt_uuid_128 to_follower_uuid = BT_UUID_INIT_128(LINK_UUID_TO_FOLLOWER_VAL);

static bt_addr_le_t peer;
static uint16_t service_end_handle;
static uint16_t to_leader_handle;
static uint16_t to_follower_handle;

/*
 * Whoever did not prove the key is left aside for a while, each time longer, so that the right one,
 * who advertises no less often, is found.
 */
#define STRANGERS        4U
#define STRANGER_WAIT_MS 1000
#define WAIT_SHIFT_MAX   6U

static struct {
	bt_addr_le_t address;
	int64_t until_ms;
	uint32_t times;
} strangers[STRANGERS];

static K_SEM_DEFINE(peer_found, 0, 1);
/* One step of the set-up at a time has ended. */
static K_SEM_DEFINE(step_ended, 0, 1);
static volatile uint8_t step_error;

/* In the link thread, while nobody scans. */
static void strangers_add(const bt_addr_le_t *address)
{
	uint32_t at = 0;

	for (uint32_t i = 0; i < STRANGERS; i++) {
		if (bt_addr_le_eq(&strangers[i].address, address)) {
			at = i;
			break;
		}
		at = strangers[i].until_ms < strangers[at].until_ms ? i : at;
	}
	if (!bt_addr_le_eq(&strangers[at].address, address)) {
		strangers[at].times = 0;
		bt_addr_le_copy(&strangers[at].address, address);
	}
	strangers[at].until_ms = k_uptime_get() + ((int64_t)STRANGER_WAIT_MS << strangers[at].times);
	strangers[at].times += strangers[at].times < WAIT_SHIFT_MAX ? 1U : 0U;
}

static bool is_left_aside(const bt_addr_le_t *address)
{
	for (uint32_t i = 0; i < STRANGERS; i++) {
		if (bt_addr_le_eq(&strangers[i].address, address)) {
			return k_uptime_get() < strangers[i].until_ms;
		}
	}
	return false;
}

static bool is_service(struct bt_data *data, void *found)
{
	if ((data->type == BT_DATA_UUID128_ALL || data->type == BT_DATA_UUID128_SOME) &&
	    data->data_len % BT_UUID_SIZE_128 == 0U) {
		for (uint8_t at = 0; at < data->data_len; at += BT_UUID_SIZE_128) {
			if (memcmp(data->data + at, service_uuid.val, BT_UUID_SIZE_128) == 0) {
				*(bool *)found = true;
			}
		}
	}
	return !*(bool *)found;
}

static void on_advertisement(const bt_addr_le_t *address, int8_t rssi, uint8_t type,
			     struct net_buf_simple *data)
{
	bool found = false;

	ARG_UNUSED(rssi);
	if ((type != BT_GAP_ADV_TYPE_ADV_IND && type != BT_GAP_ADV_TYPE_ADV_DIRECT_IND) ||
	    is_left_aside(address)) {
		return;
	}
	bt_data_parse(data, is_service, &found);
	if (found && k_sem_count_get(&peer_found) == 0U) {
		bt_addr_le_copy(&peer, address);
		k_sem_give(&peer_found);
	}
}

int link_role_seek(void)
{
	static const struct bt_le_conn_param conn_param = {
		.interval_min = CONFIG_BV_CONN_INTERVAL,
		.interval_max = CONFIG_BV_CONN_INTERVAL,
		.latency = 0,
		.timeout = CONFIG_BV_SUPERVISION_TIMEOUT,
	};
	/* Duplicates, too: who is left aside now advertises again when the time is over. */
	static const struct bt_le_scan_param scan_param = {
		.type = BT_LE_SCAN_TYPE_PASSIVE,
		.options = BT_LE_SCAN_OPT_NONE,
		.interval = BT_GAP_SCAN_FAST_INTERVAL_MIN,
		.window = BT_GAP_SCAN_FAST_WINDOW,
	};
	struct bt_conn *conn = NULL;
	int err;

	k_sem_reset(&peer_found);
	err = bt_le_scan_start(&scan_param, on_advertisement);
	if (err && err != -EALREADY) {
		return err;
	}
	(void)k_sem_take(&peer_found, K_FOREVER);
	err = bt_le_scan_stop();
	if (err && err != -EALREADY) {
		return err;
	}
	err = bt_conn_le_create(&peer, BT_CONN_LE_CREATE_CONN, &conn_param, &conn);
	if (!err) {
		/* The connected callback takes its own reference. */
		bt_conn_unref(conn);
	}
	return err;
}

static void end_step(uint8_t error)
{
	step_error = error;
	k_sem_give(&step_ended);
}

/* Wait for the step just started, whose call returned @p started. */
static int finish_step(int started)
{
	if (started) {
		return started;
	}
	if (k_sem_take(&step_ended, STEP_TIMEOUT) != 0) {
		return -ETIMEDOUT;
	}
	return step_error == 0U ? 0 : -EIO;
}

static void begin_step(void)
{
	step_error = 0;
	k_sem_reset(&step_ended);
}

static void on_phy_updated(struct bt_conn *conn, struct bt_conn_le_phy_info *info)
{
	ARG_UNUSED(conn);
	ARG_UNUSED(info);
	end_step(0);
}

static void on_disconnected(struct bt_conn *conn, uint8_t reason)
{
	ARG_UNUSED(conn);
	end_step(reason);
}

BT_CONN_CB_DEFINE(link_central_callbacks) = {
	.disconnected = on_disconnected,
	.le_phy_updated = on_phy_updated,
};

static void on_mtu(struct bt_conn *conn, uint8_t error, struct bt_gatt_exchange_params *params)
{
	ARG_UNUSED(conn);
	ARG_UNUSED(params);
	end_step(error);
}

static uint8_t on_service(struct bt_conn *conn, const struct bt_gatt_attr *attr,
			  struct bt_gatt_discover_params *params)
{
	ARG_UNUSED(conn);
	if (attr != NULL) {
		const struct bt_gatt_service_val *service = attr->user_data;

		service_end_handle = service->end_handle;
		params->start_handle = attr->handle;
	}
	end_step(attr == NULL ? BT_ATT_ERR_ATTRIBUTE_NOT_FOUND : 0);
	return BT_GATT_ITER_STOP;
}

static uint8_t on_characteristic(struct bt_conn *conn, const struct bt_gatt_attr *attr,
				 struct bt_gatt_discover_params *params)
{
	const struct bt_gatt_chrc *characteristic;

	ARG_UNUSED(conn);
	ARG_UNUSED(params);
	if (attr == NULL) {
		end_step(to_leader_handle == 0U || to_follower_handle == 0U
				 ? BT_ATT_ERR_ATTRIBUTE_NOT_FOUND
				 : 0);
		return BT_GATT_ITER_STOP;
	}
	characteristic = attr->user_data;
	if (bt_uuid_cmp(characteristic->uuid, &to_leader_uuid.uuid) == 0) {
		to_leader_handle = characteristic->value_handle;
	} else if (bt_uuid_cmp(characteristic->uuid, &to_follower_uuid.uuid) == 0) {
		to_follower_handle = characteristic->value_handle;
	}
	return BT_GATT_ITER_CONTINUE;
}

static uint8_t on_notification(struct bt_conn *conn, struct bt_gatt_subscribe_params *params,
			       const void *data, uint16_t length)
{
	ARG_UNUSED(params);
	if (conn == NULL || data == NULL) {
		return BT_GATT_ITER_STOP;
	}
	link_receive(data, length);
	return BT_GATT_ITER_CONTINUE;
}

static void on_subscribed(struct bt_conn *conn, uint8_t error,
			  struct bt_gatt_subscribe_params *params)
{
	ARG_UNUSED(conn);
	ARG_UNUSED(params);
	end_step(error);
}

static int raise_phy(struct bt_conn *conn)
{
	begin_step();
	return finish_step(bt_conn_le_phy_update(conn, BT_CONN_LE_PHY_PARAM_2M));
}

static int raise_mtu(struct bt_conn *conn)
{
	static struct bt_gatt_exchange_params params = {.func = on_mtu};

	begin_step();
	return finish_step(bt_gatt_exchange_mtu(conn, &params));
}

static int discover(struct bt_conn *conn)
{
	static struct bt_gatt_discover_params params;
	int err;

	to_leader_handle = 0;
	to_follower_handle = 0;
	params = (struct bt_gatt_discover_params){
		.uuid = &service_uuid.uuid,
		.func = on_service,
		.start_handle = BT_ATT_FIRST_ATTRIBUTE_HANDLE,
		.end_handle = BT_ATT_LAST_ATTRIBUTE_HANDLE,
		.type = BT_GATT_DISCOVER_PRIMARY,
	};
	begin_step();
	err = finish_step(bt_gatt_discover(conn, &params));
	if (err) {
		return err;
	}
	params.uuid = NULL;
	params.func = on_characteristic;
	params.end_handle = service_end_handle;
	params.type = BT_GATT_DISCOVER_CHARACTERISTIC;
	begin_step();
	return finish_step(bt_gatt_discover(conn, &params));
}

static int subscribe(struct bt_conn *conn)
{
	static struct bt_gatt_subscribe_params params;
	static struct bt_gatt_discover_params ccc_discovery;

	memset(&params, 0, sizeof(params));
	memset(&ccc_discovery, 0, sizeof(ccc_discovery));
	params.notify = on_notification;
	params.subscribe = on_subscribed;
	params.value = BT_GATT_CCC_NOTIFY;
	params.value_handle = to_leader_handle;
	params.ccc_handle = BT_GATT_AUTO_DISCOVER_CCC_HANDLE;
	params.end_handle = service_end_handle;
	params.disc_params = &ccc_discovery;
	/* A subscription that outlives its connection would be a second one on the next. */
	atomic_set_bit(params.flags, BT_GATT_SUBSCRIBE_FLAG_VOLATILE);
	begin_step();
	return finish_step(bt_gatt_subscribe(conn, &params));
}

int link_role_setup(struct bt_conn *conn)
{
	int err = link_security_wait(conn);

	if (err == -ENOTCONN) {
		return err;
	}
	if (err) {
		strangers_add(&peer);
		return err;
	}
	err = raise_phy(conn);
	if (!err) {
		err = bt_conn_le_data_len_update(conn, BT_LE_DATA_LEN_PARAM_MAX);
	}
	if (!err) {
		err = raise_mtu(conn);
	}
	if (!err) {
		err = discover(conn);
	}
	if (!err) {
		err = subscribe(conn);
	}
	return err;
}

int link_role_transmit(struct bt_conn *conn, const uint8_t *value, uint16_t len)
{
	return bt_gatt_write_without_response(conn, to_follower_handle, value, len, false);
}
