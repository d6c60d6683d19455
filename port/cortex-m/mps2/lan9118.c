/* SPDX-License-Identifier: MIT */
/* Registers and bits: SMSC LAN9118 data sheet. */
#include "lan9118.h"

#define BASE UINT32_C(0x40200000)
#define INTERRUPT 13

enum {
    RX_DATA = 0x00,
    TX_DATA = 0x20,
    RX_STATUS = 0x40,
    TX_STATUS = 0x48,
    IRQ_CFG = 0x54,
    INT_STS = 0x58,
    INT_EN = 0x5c,
    BYTE_TEST = 0x64,
    FIFO_INT = 0x68,
    TX_CFG = 0x70,
    HW_CFG = 0x74,
    RX_FIFO_INF = 0x7c,
    TX_FIFO_INF = 0x80,
    PMT_CTRL = 0x84,
    MAC_CSR_CMD = 0xa4,
    MAC_CSR_DATA = 0xa8
};
enum { MAC_CR = 1, ADDRH = 2, ADDRL = 3 };

/* Polls of a bit that the controller sets by itself: far more than it takes. */
enum { PATIENCE = 1000000 };

static volatile uint32_t *at(uint32_t offset) { return (volatile uint32_t *)(uintptr_t)(BASE + offset); }

/* Nested vectored interrupt controller of the core: set enable, clear enable, clear pending. */
static void nvic(uint32_t offset) { *(volatile uint32_t *)(uintptr_t)(UINT32_C(0xe000e100) + offset) = UINT32_C(1) << INTERRUPT; }

static int wait_for(uint32_t offset, uint32_t mask, uint32_t wanted) {
    for (int i = 0; i < PATIENCE; i++)
        if ((*at(offset) & mask) == wanted) return 1;
    return 0;
}

/* A register of the media access controller, reached through two of the host's. */
static int mac_write(uint32_t index, uint32_t value) {
    *at(MAC_CSR_DATA) = value;
    *at(MAC_CSR_CMD) = UINT32_C(1) << 31 | index;
    return wait_for(MAC_CSR_CMD, UINT32_C(1) << 31, 0);
}

int mk_lan9118_start(const uint8_t address[6]) {
    if (*at(BYTE_TEST) != UINT32_C(0x87654321) || !wait_for(PMT_CTRL, 1, 1)) return 0;
    *at(HW_CFG) = 1; /* reset */
    if (!wait_for(HW_CFG, 1, 0)) return 0;
    *at(HW_CFG) = UINT32_C(5) << 16; /* 5 KB to send from, the rest to receive */
    *at(INT_EN) = 0;
    *at(INT_STS) = UINT32_MAX;
    *at(IRQ_CFG) = 1 << 8 | 1 << 4 | 1; /* on, active high, driven */
    *at(FIFO_INT) = 0;                  /* as soon as one frame has come */
    *at(INT_EN) = 1 << 3;
    const uint32_t low = (uint32_t)address[0] | (uint32_t)address[1] << 8 | (uint32_t)address[2] << 16 | (uint32_t)address[3] << 24;
    if (!mac_write(ADDRL, low) || !mac_write(ADDRH, (uint32_t)address[4] | (uint32_t)address[5] << 8)) return 0;
    *at(TX_CFG) = 1 << 1;
    return mac_write(MAC_CR, 1 << 20 | 1 << 3 | 1 << 2); /* both directions at once, send, receive */
}

int mk_lan9118_send(const uint8_t *frame, size_t length) {
    if (length < MK_ETHERNET_HEADER || length > MK_ETHERNET_MAX) return 0;
    /* How earlier frames fared is not asked, but has to be taken out. */
    while (*at(TX_FIFO_INF) >> 16 & 0xff) (void)*at(TX_STATUS);
    if ((*at(TX_FIFO_INF) & 0xffff) < length + 16) return 0;
    *at(TX_DATA) = UINT32_C(3) << 12 | (uint32_t)length; /* first and last part of its frame */
    *at(TX_DATA) = (uint32_t)length;
    for (size_t i = 0; i < length; i += 4) {
        uint32_t word = 0;
        for (size_t j = 0; j < 4 && i + j < length; j++) word |= (uint32_t)frame[i + j] << 8 * j;
        *at(TX_DATA) = word;
    }
    return 1;
}

size_t mk_lan9118_receive(uint8_t *frame, size_t room) {
    while (*at(RX_FIFO_INF) >> 16 & 0xff) {
        const uint32_t status = *at(RX_STATUS);
        const size_t whole = status >> 16 & 0x3fff, length = whole < 4 ? 0 : whole - 4; /* without the check sequence */
        const int good = !(status & 1 << 15) && length >= MK_ETHERNET_HEADER && length <= room;
        for (size_t i = 0; i < whole; i += 4) {
            const uint32_t word = *at(RX_DATA);
            for (size_t j = 0; good && j < 4 && i + j < length; j++) frame[i + j] = (uint8_t)(word >> 8 * j);
        }
        if (good) return length;
    }
    return 0;
}

/* Masked, an enabled interrupt wakes the core but is not taken. One that comes between the look and the sleep ends the sleep at once. */
void mk_lan9118_wait(void) {
    uint32_t masked;
    __asm__ volatile("mrs %0, primask\n\tcpsid i" : "=r"(masked)::"memory");
    *at(INT_STS) = UINT32_MAX;
    nvic(0x180);
    nvic(0x000);
    if (!(*at(RX_FIFO_INF) >> 16 & 0xff)) __asm__ volatile("dsb\n\twfi" ::: "memory");
    nvic(0x080);
    *at(INT_STS) = UINT32_MAX;
    nvic(0x180);
    __asm__ volatile("msr primask, %0" ::"r"(masked) : "memory");
}
