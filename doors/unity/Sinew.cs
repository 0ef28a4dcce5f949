// Sinew for C#: the functions of sinew.h that games need, behind two classes. C# 7.3, no package. Native.cs, which is written
// from the sources of the library, holds all of them.
//
// Put the library beside it: Assets/Plugins/x86_64/libsinew.so, sinew.dll or libsinew.dylib; on iOS the static library.
// Coordinates here are those of Sinew: metres, right-handed. SinewBody.cs turns them into those of Unity.
using System;
using System.Runtime.InteropServices;
using System.Text;

namespace Sinew
{
    /// <summary>An error of the library, with its text to the letter.</summary>
    public sealed class SinewException : Exception
    {
        public readonly Code Code;

        internal SinewException(Code code, string text) : base(text) { Code = code; }
    }

    [StructLayout(LayoutKind.Sequential)]
    public struct Vec3
    {
        public double X, Y, Z;

        public Vec3(double x, double y, double z) { X = x; Y = y; Z = z; }

        public double Length { get { return Math.Sqrt(X * X + Y * Y + Z * Z); } }
    }

    public partial struct ThreadPoint
    {
        public ThreadPoint(ulong of, Vec3 at) { Of = of; At = at; }
    }

    public partial struct Pick
    {
        /// <summary>Whether it met anything.</summary>
        public bool Hit { get { return HitFlag != 0; } }
    }

    internal static partial class Native
    {
#if UNITY_IOS && !UNITY_EDITOR
        const string Library = "__Internal";
#else
        const string Library = "sinew";
#endif
        const CallingConvention C = CallingConvention.Cdecl;

        internal static byte[] Utf8(string text)
        {
            return Encoding.UTF8.GetBytes((text ?? "") + "\0");
        }

        static string Text(IntPtr data)
        {
            int length = 0;
            while (Marshal.ReadByte(data, length) != 0) { length++; }
            var bytes = new byte[length];
            Marshal.Copy(data, bytes, 0, length);
            return Encoding.UTF8.GetString(bytes);
        }

        internal static void Demand(int status)
        {
            if (status != 0) { throw new SinewException((Code)status, Text(sinew_last_error())); }
        }
    }

    /// <summary>Owns a simulation; frees it when nobody uses it any more.</summary>
    public sealed class SimulationHandle : SafeHandle
    {
        internal SimulationHandle(IntPtr own) : base(IntPtr.Zero, true) { SetHandle(own); }

        public override bool IsInvalid { get { return handle == IntPtr.Zero; } }

        protected override bool ReleaseHandle()
        {
            Native.sinew_simulation_free(handle);
            return true;
        }
    }

    /// <summary>Owns a mesh.</summary>
    public sealed class MeshHandle : SafeHandle
    {
        MeshHandle(IntPtr own) : base(IntPtr.Zero, true) { SetHandle(own); }

        /// <summary>A mesh file: Gmsh, VTK, TetGen, OBJ, STL.</summary>
        public static MeshHandle FromFile(string path)
        {
            IntPtr own;
            Native.Demand(Native.sinew_mesh_from_file(Native.Utf8(path), out own));
            return new MeshHandle(own);
        }

        /// <summary>Points (three numbers each, m) and tetrahedra (four vertices each).</summary>
        public static MeshHandle FromArrays(double[] points, uint[] tetrahedra)
        {
            var p = GCHandle.Alloc(points, GCHandleType.Pinned);
            var t = GCHandle.Alloc(tetrahedra, GCHandleType.Pinned);
            try
            {
                var arrays = new NativeMeshArrays
                {
                    StructSize = (uint)Marshal.SizeOf(typeof(NativeMeshArrays)),
                    Points = p.AddrOfPinnedObject(), PointCount = (UIntPtr)(points.Length / 3),
                    Tetrahedra = t.AddrOfPinnedObject(), TetrahedronCount = (UIntPtr)(tetrahedra.Length / 4)
                };
                IntPtr own;
                Native.Demand(Native.sinew_mesh_from_arrays(ref arrays, out own));
                return new MeshHandle(own);
            }
            finally { p.Free(); t.Free(); }
        }

        public override bool IsInvalid { get { return handle == IntPtr.Zero; } }

        protected override bool ReleaseHandle()
        {
            Native.sinew_mesh_free(handle);
            return true;
        }
    }

    /// <summary>A state of a simulation, kept to go back to.</summary>
    public sealed class SnapshotHandle : SafeHandle
    {
        internal SnapshotHandle(IntPtr own) : base(IntPtr.Zero, true) { SetHandle(own); }

        /// <summary>Reads what ToBytes gave, in any process.</summary>
        public static SnapshotHandle FromBytes(byte[] bytes)
        {
            IntPtr own;
            Native.Demand(Native.sinew_snapshot_from_bytes(bytes, (UIntPtr)bytes.Length, out own));
            return new SnapshotHandle(own);
        }

        public byte[] ToBytes()
        {
            UIntPtr needed;
            Native.Demand(Native.sinew_snapshot_to_bytes(this, null, UIntPtr.Zero, out needed));
            var bytes = new byte[(int)needed];
            Native.Demand(Native.sinew_snapshot_to_bytes(this, bytes, needed, out needed));
            return bytes;
        }

        public override bool IsInvalid { get { return handle == IntPtr.Zero; } }

        protected override bool ReleaseHandle()
        {
            Native.sinew_snapshot_free(handle);
            return true;
        }
    }

    /// <summary>The end of a haptic handle at the device, for one thread beside that of the simulation. It stays good when the
    /// simulation is gone: the force falls to zero then.</summary>
    public sealed class HapticDevice : SafeHandle
    {
        internal HapticDevice(IntPtr own) : base(IntPtr.Zero, true) { SetHandle(own); }

        /// <summary>Where the device is (m), how fast it moves (m/s), and the seconds since the last call; what it is to render until
        /// the next one. It never waits, and allocates nothing.</summary>
        public HapticFeedback Exchange(Vec3 position, Vec3 velocity, double seconds)
        {
            var felt = new HapticFeedback { StructSize = FeedbackSize };
            Native.Demand(Native.sinew_haptic_exchange(this, ref position, ref velocity, seconds, ref felt));
            return felt;
        }

        /// <summary>The same of a device that turns what it holds: its orientation as a quaternion (x, y, z, w), and its angular
        /// velocity (rad/s). At its first exchange nothing is turned.</summary>
        public HapticFeedback Exchange(Vec3 position, double[] quaternion, Vec3 velocity, Vec3 angularVelocity, double seconds)
        {
            if (quaternion == null || quaternion.Length != 4) { throw new ArgumentException("a quaternion has four numbers", "quaternion"); }
            var felt = new HapticFeedback { StructSize = FeedbackSize };
            Native.Demand(Native.sinew_haptic_exchange_pose(this, ref position, quaternion, ref velocity, ref angularVelocity,
                seconds, ref felt));
            return felt;
        }

        static readonly uint FeedbackSize = (uint)Marshal.SizeOf(typeof(HapticFeedback));

        public override bool IsInvalid { get { return handle == IntPtr.Zero; } }

        protected override bool ReleaseHandle()
        {
            Native.sinew_haptic_free(handle);
            return true;
        }
    }

    /// <summary>The last two states of bodies and tools, each whole, for one thread beside that of the simulation. It stays good
    /// when the simulation is gone.</summary>
    public sealed class LiveReader : SafeHandle
    {
        internal LiveReader(IntPtr own) : base(IntPtr.Zero, true) { SetHandle(own); }

        /// <summary>Takes the last state, its steps and its time (s); false where there is no new one. It never waits.</summary>
        public bool Update(out ulong step, out double seconds)
        {
            uint isNew;
            Native.Demand(Native.sinew_live_update(this, out isNew, out step, out seconds));
            return isNew != 0;
        }

        /// <summary>Positions (m) of a body at a time (s) between the last two states; infinity for the last one.</summary>
        public double[] Positions(ulong body, double seconds = double.PositiveInfinity)
        {
            return Read(body, Native.SINEW_LIVE_POSITIONS, seconds);
        }

        /// <summary>Unit normals of the outside of a body likewise; 0 at vertices that are not on it.</summary>
        public double[] Normals(ulong body, double seconds = double.PositiveInfinity)
        {
            return Read(body, Native.SINEW_LIVE_NORMALS, seconds);
        }

        /// <summary>Force (N) on a tool, then torque (N m) about its origin.</summary>
        public double[] Wrench(ulong tool, double seconds = double.PositiveInfinity)
        {
            return Read(tool, Native.SINEW_LIVE_WRENCH, seconds);
        }

        double[] Read(ulong of, uint quantity, double seconds)
        {
            UIntPtr needed;
            Native.Demand(Native.sinew_live_read(this, of, quantity, seconds, null, UIntPtr.Zero, out needed));
            var values = new double[(int)needed];
            Native.Demand(Native.sinew_live_read(this, of, quantity, seconds, values, needed, out needed));
            return values;
        }

        public override bool IsInvalid { get { return handle == IntPtr.Zero; } }

        protected override bool ReleaseHandle()
        {
            Native.sinew_live_free(handle);
            return true;
        }
    }

    /// <summary>A simulation. One thread at a time may use it. Handles of bodies and other things are numbers.</summary>
    public sealed class Simulation : IDisposable
    {
        readonly SimulationHandle own;

        static Simulation()
        {
            if (Native.sinew_abi_version() != Native.SINEW_ABI)
            {
                throw new SinewException(Code.Argument, "Native.cs and the library do not belong together");
            }
        }

        Simulation(IntPtr made) { own = new SimulationHandle(made); }

        /// <summary>Without bodies; dt in s, gravity in m/s^2, threads 0: one less than there are cores.</summary>
        public Simulation(double dt, Vec3 gravity, uint threads)
        {
            var options = new NativeOptions
            {
                StructSize = (uint)Marshal.SizeOf(typeof(NativeOptions)), Dt = dt, Gravity = gravity, Threads = threads
            };
            IntPtr made;
            Native.Demand(Native.sinew_simulation_new(ref options, out made));
            own = new SimulationHandle(made);
        }

        /// <summary>Of a scene file.</summary>
        public static Simulation FromScene(string path, uint threads)
        {
            IntPtr made;
            Native.Demand(Native.sinew_simulation_from_scene(Native.Utf8(path), threads, out made));
            return new Simulation(made);
        }

        public void Dispose() { own.Dispose(); }

        /// <summary>Adds a body of a tissue preset; youngModulus (Pa) 0 for that of the preset; spare: vertices kept for what cuts
        /// make.</summary>
        public ulong AddBody(string name, MeshHandle mesh, string preset, double youngModulus, int spare = 0)
        {
            using (var texts = new Pins(Native.Utf8(name), Native.Utf8(preset)))
            {
                var material = new NativeMaterial
                {
                    StructSize = (uint)Marshal.SizeOf(typeof(NativeMaterial)), Preset = texts[1], YoungModulus = youngModulus
                };
                var place = GCHandle.Alloc(material, GCHandleType.Pinned);
                try
                {
                    var body = new NativeBody
                    {
                        StructSize = (uint)Marshal.SizeOf(typeof(NativeBody)), Name = texts[0],
                        Material = place.AddrOfPinnedObject(), Spare = (UIntPtr)spare
                    };
                    ulong handle;
                    Native.Demand(Native.sinew_body_add(own, mesh, ref body, out handle));
                    return handle;
                }
                finally { place.Free(); }
            }
        }

        /// <summary>What looks unintended in meshes and materials, then in the steps that led to the present state: JSON, an
        /// array of objects with code, level, subject, message and remedy.</summary>
        public string WarningsJson()
        {
            UIntPtr needed;
            Native.Demand(Native.sinew_warnings_json(own, null, UIntPtr.Zero, out needed));
            var text = new byte[(int)needed];
            Native.Demand(Native.sinew_warnings_json(own, text, needed, out needed));
            return Encoding.UTF8.GetString(text, 0, text.Length - 1);
        }

        /// <summary>Why the present state cannot be trusted; empty where it can.</summary>
        public string Verdict()
        {
            UIntPtr needed;
            Native.Demand(Native.sinew_verdict(own, null, UIntPtr.Zero, out needed));
            var text = new byte[(int)needed];
            Native.Demand(Native.sinew_verdict(own, text, needed, out needed));
            return Encoding.UTF8.GetString(text, 0, text.Length - 1);
        }

        public ulong Find(Kind kind, string name)
        {
            ulong handle;
            Native.Demand(Native.sinew_find(own, (uint)kind, Native.Utf8(name), out handle));
            return handle;
        }

        /// <summary>Takes a body, constraint, load, pressure, tool, pull, contact, thread or clip away. With a body goes what acts on nothing
        /// else.</summary>
        public void Remove(ulong handle) { Native.Demand(Native.sinew_remove(own, handle)); }

        /// <summary>Length of every list of vertices. It may grow: ask again when SurfaceRevision is another one.</summary>
        public int VertexCount(ulong body)
        {
            UIntPtr count;
            Native.Demand(Native.sinew_vertex_count(own, body, out count));
            return (int)count;
        }

        public uint[] Group(ulong body, string name)
        {
            UIntPtr needed;
            Native.Demand(Native.sinew_group_vertices(own, body, Native.Utf8(name), null, UIntPtr.Zero, out needed));
            var list = new uint[(int)needed];
            Native.Demand(Native.sinew_group_vertices(own, body, Native.Utf8(name), list, needed, out needed));
            return list;
        }

        public ulong Hold(ulong body, string name, uint[] vertices)
        {
            ulong handle;
            var count = (UIntPtr)vertices.Length;
            Native.Demand(Native.sinew_hold(own, body, Native.Utf8(name), vertices, count, out handle));
            return handle;
        }

        /// <summary>Translation (m) of what a constraint holds, at the end of the next step.</summary>
        public void MoveConstraint(ulong constraint, Vec3 by)
        {
            Native.Demand(Native.sinew_constraint_pose(own, constraint, ref by, null, null));
        }

        /// <summary>Force (N) of a constraint on its body.</summary>
        public Vec3 Reaction(ulong constraint)
        {
            Vec3 about = new Vec3(), force, torque;
            Native.Demand(Native.sinew_reaction(own, constraint, ref about, out force, out torque));
            return force;
        }

        /// <summary>Adds a ball (m) that touches all bodies; with `ToolFlags.Cavity` they may not leave it.</summary>
        public ulong AddBall(string name, Vec3 position, double radius, double friction, ToolFlags flags = ToolFlags.None)
        {
            var part = new NativePart { StructSize = (uint)Marshal.SizeOf(typeof(NativePart)), Radius = radius };
            var place = GCHandle.Alloc(part, GCHandleType.Pinned);
            try
            {
                using (var texts = new Pins(Native.Utf8(name)))
                {
                    var tool = new NativeTool
                    {
                        StructSize = (uint)Marshal.SizeOf(typeof(NativeTool)), Name = texts[0],
                        Parts = place.AddrOfPinnedObject(), PartCount = (UIntPtr)1, Position = position, Friction = friction,
                        Flags = (uint)flags
                    };
                    ulong handle;
                    Native.Demand(Native.sinew_tool_add(own, ref tool, out handle));
                    return handle;
                }
            }
            finally { place.Free(); }
        }

        /// <summary>Adds a tool with an edge that cuts or a needle, in lines as below `edge` or `needle` in a scene; the other is
        /// null.</summary>
        public ulong AddBlade(string name, Vec3 position, string edge, string needle = null)
        {
            using (var texts = new Pins(Native.Utf8(name), Native.Utf8(edge), Native.Utf8(needle)))
            {
                var tool = new NativeTool
                {
                    StructSize = (uint)Marshal.SizeOf(typeof(NativeTool)), Name = texts[0], Position = position,
                    Edge = edge == null ? IntPtr.Zero : texts[1], Needle = needle == null ? IntPtr.Zero : texts[2]
                };
                ulong handle;
                Native.Demand(Native.sinew_tool_add(own, ref tool, out handle));
                return handle;
            }
        }

        /// <summary>Lays a thread or sets a clip (Kind.Thread, Kind.Clip); lines as in a scene: name, stiffness and so on.</summary>
        public ulong AddThread(Kind kind, string lines, params ThreadPoint[] points)
        {
            ulong handle;
            var count = (UIntPtr)points.Length;
            Native.Demand(Native.sinew_thread_add(own, (uint)kind, Native.Utf8(lines), points, count, out handle));
            return handle;
        }

        /// <summary>Moves a place in space that a thread goes through, by its number.</summary>
        public void MoveThread(ulong thread, int point, Vec3 position)
        {
            Native.Demand(Native.sinew_thread_move(own, thread, (uint)point, ref position));
        }

        /// <summary>Draws a thread past its first (end 0) or last (1) point: the length (m) in all.</summary>
        public void DrawThread(ulong thread, int end, double length)
        {
            Native.Demand(Native.sinew_thread_draw(own, thread, (uint)end, length));
        }

        /// <summary>Holds a free end of a thread, the first (0) or last (1): it slides through there no more.</summary>
        public void HoldThread(ulong thread, int end) { Native.Demand(Native.sinew_thread_hold(own, thread, (uint)end)); }

        /// <summary>Ties the ends of a thread together, and lets hands go.</summary>
        public void TieThread(ulong thread) { Native.Demand(Native.sinew_thread_tie(own, thread)); }

        /// <summary>Cuts a thread; the part behind the segment, or 0. The handle stands for the first part that is left.</summary>
        public ulong CutThread(ulong thread, int segment)
        {
            ulong first, second;
            Native.Demand(Native.sinew_thread_cut(own, thread, (uint)segment, out first, out second));
            return second;
        }

        /// <summary>Lets a body tear, in lines as below `tear` in a scene; null: no more.</summary>
        public void SetTear(ulong body, string lines)
        {
            Native.Demand(Native.sinew_tear_set(own, body, lines == null ? null : Native.Utf8(lines)));
        }

        /// <summary>Cuts a body that has spare vertices: both ends (m) of the edge of the blade, one position after another.</summary>
        public CutReport Cut(ulong body, double[] strip)
        {
            var report = new CutReport { StructSize = (uint)Marshal.SizeOf(typeof(CutReport)) };
            Native.Demand(Native.sinew_cut(own, body, strip, (UIntPtr)(strip.Length / 6), ref report));
            return report;
        }

        /// <summary>What to draw of a body that may be cut: points (m), triangles, and of each 1 if a cut laid it open.</summary>
        public double[] Skin(ulong body, out uint[] triangles, out uint[] wound)
        {
            UIntPtr needed;
            ulong revision;
            Native.Demand(Native.sinew_skin_read(own, body, Native.SINEW_SKIN_POINTS, null, UIntPtr.Zero, out needed));
            var points = new double[(int)needed];
            Native.Demand(Native.sinew_skin_read(own, body, Native.SINEW_SKIN_POINTS, points, needed, out needed));
            Native.Demand(Native.sinew_skin_triangles(own, body, null, UIntPtr.Zero, out needed, out revision));
            triangles = new uint[(int)needed];
            Native.Demand(Native.sinew_skin_triangles(own, body, triangles, needed, out needed, out revision));
            wound = new uint[triangles.Length / 3];
            Native.Demand(Native.sinew_skin_wound(own, body, wound, (UIntPtr)wound.Length, out needed));
            return points;
        }

        /// <summary>Moves a tool to a place (m): it is there at the end of the next step.</summary>
        public void MoveTool(ulong tool, Vec3 position)
        {
            Native.Demand(Native.sinew_tool_move(own, tool, ref position, null, 0.0, 0));
        }

        /// <summary>What a tool felt in the last step.</summary>
        public ToolReport ToolReport(ulong tool)
        {
            var report = new ToolReport { StructSize = (uint)Marshal.SizeOf(typeof(ToolReport)) };
            Native.Demand(Native.sinew_read_tool_report(own, tool, ref report));
            return report;
        }

        /// <summary>The first point of a surface that a ray meets.</summary>
        public Pick Ray(Vec3 origin, Vec3 direction)
        {
            var pick = new Pick { StructSize = (uint)Marshal.SizeOf(typeof(Pick)) };
            Native.Demand(Native.sinew_pick(own, ref origin, ref direction, ref pick));
            return pick;
        }

        /// <summary>Takes hold of what a ray met; stiffness in N/m, damping in N s/m.</summary>
        public ulong AddPull(string name, Pick pick, double stiffness, double damping)
        {
            var vertices = GCHandle.Alloc(new[] { pick.Vertex0, pick.Vertex1, pick.Vertex2 }, GCHandleType.Pinned);
            var weights = GCHandle.Alloc(pick.Weights, GCHandleType.Pinned);
            try
            {
                using (var texts = new Pins(Native.Utf8(name)))
                {
                    var pull = new NativePull
                    {
                        StructSize = (uint)Marshal.SizeOf(typeof(NativePull)), Name = texts[0],
                        Vertices = vertices.AddrOfPinnedObject(), VertexCount = (UIntPtr)3,
                        Weights = weights.AddrOfPinnedObject(), Stiffness = stiffness, Damping = damping
                    };
                    ulong handle;
                    Native.Demand(Native.sinew_pull_add(own, pick.Body, ref pull, out handle));
                    return handle;
                }
            }
            finally { vertices.Free(); weights.Free(); }
        }

        /// <summary>Translation (m) of the hand of a pull since it took hold.</summary>
        public void MovePull(ulong pull, Vec3 by)
        {
            Native.Demand(Native.sinew_pull_move(own, pull, ref by, null, null));
        }

        /// <summary>Removes elements whose barycentre lies in a ball (m); how many went.</summary>
        public int RemoveBall(ulong body, Vec3 centre, double radius)
        {
            var region = new NativeRegion
            {
                StructSize = (uint)Marshal.SizeOf(typeof(NativeRegion)), Kind = Native.SINEW_BALL, From = centre, Radius = radius
            };
            UIntPtr removed;
            Native.Demand(Native.sinew_remove_elements(own, body, ref region, out removed));
            return (int)removed;
        }

        public void Step(int n) { Native.Demand(Native.sinew_step(own, checked((uint)n))); }

        /// <summary>Lets a haptic device hold vertices by a spring (N/m, 0: 300) from the next step on, and turn them where it says so;
        /// every Step serves it. The handle is a pull. A tool in place of the body, without vertices, is held itself. Release lets go of either.</summary>
        public ulong AddHaptic(string name, ulong body, uint[] vertices, out HapticDevice device, double stiffness = 0.0,
            bool turns = false)
        {
            var list = GCHandle.Alloc(vertices, GCHandleType.Pinned);
            try
            {
                using (var texts = new Pins(Native.Utf8(name)))
                {
                    var options = new NativeHapticOptions
                    {
                        StructSize = (uint)Marshal.SizeOf(typeof(NativeHapticOptions)), Name = texts[0],
                        Vertices = list.AddrOfPinnedObject(), VertexCount = (UIntPtr)vertices.Length, Stiffness = stiffness,
                        Turns = turns ? 1u : 0u
                    };
                    ulong handle;
                    IntPtr made;
                    Native.Demand(Native.sinew_haptic_add(own, body, ref options, out handle, out made));
                    device = new HapticDevice(made);
                    return handle;
                }
            }
            finally { list.Free(); }
        }

        /// <summary>Has a device let go of what it holds: a pull is gone, a tool stays where it stands and moves as it is told again.</summary>
        public void Release(ulong held) { Native.Demand(Native.sinew_haptic_release(own, held)); }

        /// <summary>Shares all bodies and tools that there are now with another thread, after every step.</summary>
        public LiveReader Share()
        {
            IntPtr made;
            Native.Demand(Native.sinew_live_share(own, null, UIntPtr.Zero, null, UIntPtr.Zero, out made));
            return new LiveReader(made);
        }

        /// <summary>Keeps everything that the steps to come depend on.</summary>
        public SnapshotHandle Snapshot()
        {
            IntPtr made;
            Native.Demand(Native.sinew_snapshot_take(own, out made));
            return new SnapshotHandle(made);
        }

        /// <summary>Goes back to a state of this simulation, or of one that was built in the same way.</summary>
        public void Restore(SnapshotHandle snapshot) { Native.Demand(Native.sinew_snapshot_restore(own, snapshot)); }

        public double Time
        {
            get
            {
                double seconds;
                Native.Demand(Native.sinew_time(own, out seconds));
                return seconds;
            }
        }

        public double Dt { set { Native.Demand(Native.sinew_set_dt(own, value)); } }

        /// <summary>Lines as below [solver] of a scene.</summary>
        public string Solver { set { Native.Demand(Native.sinew_set_solver(own, Native.Utf8(value))); } }

        /// <summary>Numbers of a body in the order of its mesh, or of a thread or clip.</summary>
        public double[] Read(ulong body, Quantity quantity)
        {
            UIntPtr needed;
            Native.Demand(Native.sinew_read(own, body, (uint)quantity, null, UIntPtr.Zero, out needed));
            var values = new double[(int)needed];
            Native.Demand(Native.sinew_read(own, body, (uint)quantity, values, needed, out needed));
            return values;
        }

        /// <summary>Positions (m) as three floats a vertex into memory of the caller; nothing is allocated.</summary>
        public void Positions(ulong body, IntPtr xyz, int vertices, int strideBytes)
        {
            var count = (UIntPtr)vertices;
            Native.Demand(Native.sinew_positions_f32(own, body, xyz, count, (UIntPtr)strideBytes));
        }

        /// <summary>Changes when the triangles or the vertices of a surface do; allocates nothing.</summary>
        public ulong SurfaceRevision(ulong body)
        {
            UIntPtr needed;
            ulong revision;
            Native.Demand(Native.sinew_surface(own, body, null, UIntPtr.Zero, out needed, out revision));
            return revision;
        }

        /// <summary>Triangles to draw a body by, counter-clockwise seen from outside.</summary>
        public int[] Surface(ulong body)
        {
            UIntPtr needed;
            ulong revision;
            Native.Demand(Native.sinew_surface(own, body, null, UIntPtr.Zero, out needed, out revision));
            var list = new int[(int)needed];
            // the runtime takes one for the other; compilers want to be told
            Native.Demand(Native.sinew_surface(own, body, (uint[])(object)list, needed, out needed, out revision));
            return list;
        }

        /// <summary>Equal hashes mean equal results to the last bit.</summary>
        public ulong Hash
        {
            get
            {
                ulong hash;
                Native.Demand(Native.sinew_hash(own, out hash));
                return hash;
            }
        }

        /// <summary>Texts that stay in their places while they are used.</summary>
        sealed class Pins : IDisposable
        {
            readonly GCHandle[] pins;

            internal Pins(params byte[][] texts)
            {
                pins = Array.ConvertAll(texts, text => GCHandle.Alloc(text, GCHandleType.Pinned));
            }

            internal IntPtr this[int i] { get { return pins[i].AddrOfPinnedObject(); } }

            public void Dispose()
            {
                foreach (var pin in pins) { pin.Free(); }
            }
        }
    }
}
