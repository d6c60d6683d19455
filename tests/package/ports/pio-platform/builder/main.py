# SPDX-License-Identifier: MIT
from SCons.Script import Default, DefaultEnvironment

env = DefaultEnvironment()
prefix = env.GetProjectOption("custom_prefix", "")
env.Replace(**{tool: prefix + name for tool, name in {"CC": "gcc", "CXX": "g++", "AR": "ar", "RANLIB": "ranlib", "LINK": "gcc"}.items()})
env.Append(LINKFLAGS=env.GetProjectOption("custom_link_flags", "").split())
Default(env.BuildProgram())
