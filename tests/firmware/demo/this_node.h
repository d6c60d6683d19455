/* SPDX-License-Identifier: MIT */
/* One source for every node of a network. Compiled with -DNODE=07 it includes node_07.h, which `meshkal design --c-header` made, and
   node_start is node07_start, and so on. */
#ifndef THIS_NODE_H
#define THIS_NODE_H

#define THIS_TEXT_(x) #x
#define THIS_TEXT(x) THIS_TEXT_(x)
#define THIS_JOIN_(a, b, c) a##b##c
#define THIS_JOIN(a, b, c) THIS_JOIN_(a, b, c)

#include THIS_TEXT(THIS_JOIN(node_, NODE, ).h)

#define node_t THIS_JOIN(node, NODE, _t)
#define node_config THIS_JOIN(node, NODE, _config)
#define node_frame_max THIS_JOIN(node, NODE, _frame_max)
#define node_start THIS_JOIN(node, NODE, _start)
#define node_measure THIS_JOIN(node, NODE, _measure)
#define node_frame THIS_JOIN(node, NODE, _frame)
#define node_accept THIS_JOIN(node, NODE, _accept)
#define node_incremental THIS_JOIN(node, NODE, _incremental)
#define node_diffuse THIS_JOIN(node, NODE, _diffuse)
#define node_estimate THIS_JOIN(node, NODE, _estimate)

#endif
