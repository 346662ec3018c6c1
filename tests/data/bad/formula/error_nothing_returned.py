# 4: forward(): 'T_base_tool' is NoneType, not a pose (4, 4)


def forward(q):
    x = q[0]
