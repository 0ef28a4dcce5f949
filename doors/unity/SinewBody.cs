// A body of a Sinew scene in Unity: steps in FixedUpdate, draws in Update, allocates nothing while nothing is cut.
//
// Sinew is right-handed and usually has z up, Unity is left-handed with y up: y and z change places here and nowhere else,
// which turns windings round too.
using System;
using Unity.Collections;
using Unity.Collections.LowLevel.Unsafe;
using UnityEngine;
using UnityEngine.Rendering;

[RequireComponent(typeof(MeshFilter), typeof(MeshRenderer))]
public sealed class SinewBody : MonoBehaviour
{
    [Tooltip("Path of a scene file; its meshes are looked for beside it.")]
    public string scene = "liver.toml";
    [Tooltip("Name of the body in the scene.")]
    public string body = "liver";
    [Tooltip("Threads; 0 for as many as the scene says.")]
    public int threads = 2;

    Sinew.Simulation simulation;
    ulong handle, pull, revision;
    Mesh mesh;
    NativeArray<Vector3> positions;
    bool pulling;

    /// <summary>From coordinates of Sinew to those of Unity, and back.</summary>
    public static Vector3 Swap(Vector3 v) { return new Vector3(v.x, v.z, v.y); }

    static Sinew.Vec3 ToSinew(Vector3 v) { return new Sinew.Vec3(v.x, v.z, v.y); }

    void OnEnable()
    {
        simulation = Sinew.Simulation.FromScene(scene, (uint)Math.Max(threads, 0));
        simulation.Dt = Time.fixedDeltaTime;
        handle = simulation.Find(Sinew.Kind.Body, body);
        mesh = new Mesh { indexFormat = IndexFormat.UInt32 };
        mesh.MarkDynamic();
        GetComponent<MeshFilter>().sharedMesh = mesh;
        revision = 0;
        Draw();
    }

    void OnDisable()
    {
        if (simulation != null) { simulation.Dispose(); }
        if (positions.IsCreated) { positions.Dispose(); }
        simulation = null;
        pulling = false;
    }

    void FixedUpdate()
    {
        try { simulation.Step(1); }
        catch (Sinew.SinewException error)
        {
            // the state is that before the step; going on would fail again
            Debug.LogError(error.Message, this);
            enabled = false;
        }
    }

    void Update() { Draw(); }

    /// <summary>Makes room for the vertices that there are now.</summary>
    void MakeRoom()
    {
        var count = simulation.VertexCount(handle);
        if (positions.IsCreated)
        {
            if (positions.Length == count) { return; }
            positions.Dispose();
        }
        positions = new NativeArray<Vector3>(count, Allocator.Persistent);
        mesh.SetVertexBufferParams(count,
            new VertexAttributeDescriptor(VertexAttribute.Position, VertexAttributeFormat.Float32, 3, 0),
            new VertexAttributeDescriptor(VertexAttribute.Normal, VertexAttributeFormat.Float32, 3, 1));
    }

    unsafe void Draw()
    {
        if (simulation == null) { return; }
        var now = simulation.SurfaceRevision(handle);
        if (now != revision) { MakeRoom(); }
        var data = (Vector3*)NativeArrayUnsafeUtility.GetUnsafePtr(positions);
        simulation.Positions(handle, (IntPtr)data, positions.Length, sizeof(Vector3));
        for (int i = 0; i < positions.Length; i++) { data[i] = Swap(data[i]); }
        mesh.SetVertexBufferData(positions, 0, 0, positions.Length, 0, MeshUpdateFlags.DontValidateIndices);
        if (now != revision)
        {
            revision = now;
            var triangles = simulation.Surface(handle);
            for (int i = 0; i < triangles.Length; i += 3)
            {
                var first = triangles[i];
                triangles[i] = triangles[i + 1];
                triangles[i + 1] = first;
            }
            mesh.SetTriangles(triangles, 0);
        }
        mesh.RecalculateNormals();
        mesh.RecalculateBounds();
    }

    /// <summary>Takes hold of the tissue under a ray of this object's space; whether there is any.</summary>
    public bool Grab(Vector3 origin, Vector3 direction, float stiffness)
    {
        LetGo();
        var pick = simulation.Ray(ToSinew(origin), ToSinew(direction));
        if (!pick.Hit) { return false; }
        pull = simulation.AddPull("hand of " + name, pick, stiffness, 0.01 * stiffness);
        pulling = true;
        return true;
    }

    /// <summary>Moves the hand by so much since it took hold.</summary>
    public void Drag(Vector3 by)
    {
        if (pulling) { simulation.MovePull(pull, ToSinew(by)); }
    }

    public void LetGo()
    {
        if (pulling) { simulation.Remove(pull); }
        pulling = false;
    }

    /// <summary>Removes the tissue within a ball; how many elements went.</summary>
    public int Cut(Vector3 centre, float radius) { return simulation.RemoveBall(handle, ToSinew(centre), radius); }
}
