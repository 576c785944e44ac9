/* SPDX-License-Identifier: Apache-2.0 */
#include <errno.h>

#include <zephyr/bluetooth/bluetooth.h>
#include <zephyr/bluetooth/gatt.h>
#include <zephyr/kernel.h>

#include "link.h"
#include "link_role.h"
#include "link_security.h"

/* Long enough for the leader's whole set-up over a bad channel. */
#define SUBSCRIBE_TIMEOUT K_SECONDS(10)

static K_SEM_DEFINE(subscribed, 0, 1);

static const struct bt_uuid_128 service_uuid = BT_UUID_INIT_128(LINK_UUID_SERVICE_VAL);
static const struct bt_uuid_128 to_leader_uuid = BT_UUID_INIT_128(LINK_UUID_TO_LEADER_VAL);
static const struct bt_uuid_128 to_follower_uuid = BT_UUID_INIT_128(LINK_UUID_TO_FOLLOWER_VAL);

static ssize_t on_write(struct bt_conn *conn, const struct bt_gatt_attr *attr, const void *buf,
			uint16_t len, uint16_t offset, uint8_t flags)
{
	ARG_UNUSED(conn);
	ARG_UNUSED(attr);
	if (offset != 0U || (flags & BT_GATT_WRITE_FLAG_PREPARE) != 0U) {
		return BT_GATT_ERR(BT_ATT_ERR_INVALID_OFFSET);
	}
	link_receive(buf, len);
	return len;
}

/* Not only the subscription ends the wait for it. */
static void on_disconnected(struct bt_conn *conn, uint8_t reason)
{
	ARG_UNUSED(conn);
	ARG_UNUSED(reason);
	k_sem_give(&subscribed);
}

BT_CONN_CB_DEFINE(link_peripheral_callbacks) = {
	.disconnected = on_disconnected,
};

static void on_subscription(const struct bt_gatt_attr *attr, uint16_t value)
{
	ARG_UNUSED(attr);
	if (value == BT_GATT_CCC_NOTIFY) {
		k_sem_give(&subscribed);
	}
}

BT_GATT_SERVICE_DEFINE(link_service, BT_GATT_PRIMARY_SERVICE(&service_uuid),
		       BT_GATT_CHARACTERISTIC(&to_leader_uuid.uuid, BT_GATT_CHRC_NOTIFY,
					      BT_GATT_PERM_NONE, NULL, NULL, NULL),
		       BT_GATT_CCC(on_subscription,
				   BT_GATT_PERM_READ_AUTHEN | BT_GATT_PERM_WRITE_AUTHEN),
		       BT_GATT_CHARACTERISTIC(&to_follower_uuid.uuid,
					      BT_GATT_CHRC_WRITE_WITHOUT_RESP,
					      BT_GATT_PERM_WRITE_AUTHEN, NULL, on_write, NULL), );

/* Attribute of the notify characteristic's value, by its place in the table above. */
#define TO_LEADER_ATTR (&link_service.attrs[2])

static const struct bt_data advertisement[] = {
	BT_DATA_BYTES(BT_DATA_FLAGS, (BT_LE_AD_GENERAL | BT_LE_AD_NO_BREDR)),
	BT_DATA_BYTES(BT_DATA_UUID128_ALL, LINK_UUID_SERVICE_VAL),
};

int link_role_seek(void)
{
	int err;

	k_sem_reset(&subscribed);
	err = bt_le_adv_start(BT_LE_ADV_CONN_FAST_1, advertisement, ARRAY_SIZE(advertisement),
			      NULL, 0);
	return err == -EALREADY ? 0 : err;
}

int link_role_setup(struct bt_conn *conn)
{
	int err = link_security_wait(conn);

	if (!err) {
		err = k_sem_take(&subscribed, SUBSCRIBE_TIMEOUT);
	}

	/* Each side grants only what it receives. Without this the follower, whose batches are long,
	 * would send them in pieces of 27 bytes. The leader's own procedures are over by now.
	 */
	return err ? err : bt_conn_le_data_len_update(conn, BT_LE_DATA_LEN_PARAM_MAX);
}

int link_role_transmit(struct bt_conn *conn, const uint8_t *value, uint16_t len)
{
	return bt_gatt_notify(conn, TO_LEADER_ATTR, value, len);
}
