"""Render: a scene and a camera to a picture, stage by stage and band by band."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.raster.bin import OPAQUE, bin_triangles
from luxel.raster.clip import clip
from luxel.raster.bin import NO_CLIPPED
from luxel.raster.constants import sample_pattern
from luxel.raster.cover import cover
from luxel.raster.geometry import flatten
from luxel.raster.lanes import LANES
from luxel.raster.lighting import pack_lights
from luxel.raster.materials import NEEDS_VIEW, pack_materials
#from luxel.raster.picture import Picture
from luxel.raster.project import View, Window, project
from luxel.raster.shade import NEEDS_POSITION, Eye, Target, shade


def render(scene, camera=None, size=(1280, 720), *, samples=1, threads=None, shading=None):
    T=[time.perf_counter()]
    width,height=size
    geo=flatten(scene); mats=pack_materials(scene,shading); lights=pack_lights(scene,camera)
    T.append(time.perf_counter())
    view=View(camera.clip_from_world(size),0.0); win=Window(0,0,width,height,width,height)
    screen,unsafe=project(geo.positions,view,win,threads)
    T.append(time.perf_counter())
    cl=clip(geo.positions,geo.triangles,screen,view,win,threads) if unsafe else NO_CLIPPED
    pat=sample_pattern(samples); tile=64
    bins=bin_triangles(geo.triangles,screen,cl,geo.parts,OPAQUE,pat,win,tile,threads)
    T.append(time.perf_counter())
    nt=bins.across*bins.down
    ids=np.empty((nt,samples*tile*tile+LANES),np.int32); dep=np.empty((0,samples*tile*tile+LANES),np.float32)
    cover(bins,geo.triangles,screen,cl,pat,width,height,0,nt,ids,dep,threads)
    T.append(time.perf_counter())
    color=np.empty((height,width),np.uint32)
    feat=mats.features | (NEEDS_POSITION if mats.features&NEEDS_VIEW else 0)
    eye=Eye(camera.eye.astype(np.float32),camera.world_from_camera[:3,2].astype(np.float32),camera.yfov is None)
    shade(bins,0,nt,width,height,ids,pat,False,geo,screen,cl,mats,lights,eye,feat,1.0,np.zeros(4,np.float32),Target(color,np.empty((0,0,4),np.float32),np.empty((0,0),np.float32)),threads)
    T.append(time.perf_counter())
    return color.view(np.uint8).reshape(height,width,4), np.diff(T)*1e3
